defmodule BB.Error.Safety.CollisionRisk do
  @moduledoc """
  A component is about to collide.

      iex> error = %BB.Error.Safety.CollisionRisk{
      ...>   component_path: [:base, :bumper],
      ...>   collision_type: :obstacle,
      ...>   details: "0.1 m ahead"
      ...> }
      iex> Exception.message(error)
      "component [:base, :bumper] risks a collision (obstacle): 0.1 m ahead"
  """

  use BB.Error, class: :safety, fields: [:component_path, :collision_type, :details]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :critical
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "component #{inspect(e.component_path)} risks a collision (#{text(e.collision_type)}): " <>
      "#{text(e.details)}"
  end
end
