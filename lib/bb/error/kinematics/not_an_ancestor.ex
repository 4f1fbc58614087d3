defmodule BB.Error.Kinematics.NotAnAncestor do
  @moduledoc """
  A chain of joints was asked for between two links, and none of them leads to the other.

      iex> error = %BB.Error.Kinematics.NotAnAncestor{
      ...>   source_link: :left_gripper,
      ...>   target_link: :right_gripper,
      ...>   common_ancestor: :torso
      ...> }
      iex> Exception.message(error)
      ":left_gripper is not an ancestor of :right_gripper, " <>
        "their nearest common ancestor is :torso"
  """

  use BB.Error, class: :kinematics, fields: [:source_link, :target_link, :common_ancestor]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "#{inspect(e.source_link)} is not an ancestor of #{inspect(e.target_link)}" <>
      common(e.common_ancestor)
  end

  defp common(nil), do: ""
  defp common(link), do: ", their nearest common ancestor is #{inspect(link)}"
end
