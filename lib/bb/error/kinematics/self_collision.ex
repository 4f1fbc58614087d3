defmodule BB.Error.Kinematics.SelfCollision do
  @moduledoc """
  Two links of a robot would collide.

      iex> Exception.message(%BB.Error.Kinematics.SelfCollision{link_a: :forearm, link_b: :base})
      "link :forearm collides with link :base"
  """

  use BB.Error, class: :kinematics, fields: [:link_a, :link_b, :joint_positions]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e),
    do: "link #{inspect(e.link_a)} collides with link #{inspect(e.link_b)}"
end
