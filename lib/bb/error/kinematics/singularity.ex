defmodule BB.Error.Kinematics.Singularity do
  @moduledoc """
  The joints are too near to a position in which a link cannot move in some direction.

      iex> error = %BB.Error.Kinematics.Singularity{
      ...>   manipulability: 0.001,
      ...>   threshold: 0.01
      ...> }
      iex> Exception.message(error)
      "joints are near a singularity: manipulability 0.001, expected at least 0.01"
  """

  use BB.Error, class: :kinematics, fields: [:joint_positions, :manipulability, :threshold]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "joints are near a singularity: manipulability #{text(e.manipulability)}, " <>
      "expected at least #{text(e.threshold)}"
  end
end
