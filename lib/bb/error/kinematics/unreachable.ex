defmodule BB.Error.Kinematics.Unreachable do
  @moduledoc """
  A pose is out of the reach of a link.

      iex> error = %BB.Error.Kinematics.Unreachable{
      ...>   target_link: :tool,
      ...>   reason: "the target is too far away"
      ...> }
      iex> Exception.message(error)
      "link :tool cannot reach the target: the target is too far away"
  """

  use BB.Error,
    class: :kinematics,
    fields: [:target_link, :target_pose, :reason, :iterations, :residual, :positions]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e),
    do: "link #{inspect(e.target_link)} cannot reach the target: #{text(e.reason)}"
end
