defmodule BB.Error.Kinematics.NoParentJoint do
  @moduledoc """
  The root link was asked for its parent joint.

      iex> Exception.message(%BB.Error.Kinematics.NoParentJoint{link: :base})
      "link :base has no parent joint: the link is the root of the topology"
  """

  use BB.Error, class: :kinematics, fields: [:link]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e),
    do: "link #{inspect(e.link)} has no parent joint: the link is the root of the topology"
end
