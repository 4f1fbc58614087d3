defmodule BB.Error.Invalid.Topology do
  @moduledoc """
  The topology of a robot is invalid.

      iex> error = %BB.Error.Invalid.Topology{
      ...>   module: MyRobot,
      ...>   location: [:base, :elbow],
      ...>   message: "the joint has no child link"
      ...> }
      iex> Exception.message(error)
      "topology of MyRobot at [:base, :elbow]: the joint has no child link"
  """

  use BB.Error, class: :invalid, fields: [:module, :location, :message]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e),
    do: "topology of #{inspect(e.module)} at #{inspect(e.location)}: #{text(e.message)}"
end
