defmodule BB.Robot.Shapes do
  @moduledoc """
  Converts the shapes of a declared link to SI units. Pure. `BB.Robot.Builder` uses it.

      iex> import BB.Unit
      iex> BB.Robot.Shapes.geometry(%BB.Dsl.Sphere{radius: ~u(5 centimeter)})
      {:sphere, %{radius: 0.05}}
  """

  alias BB.Robot.{Link, Resolved}

  @doc "Returns the visual of a link, or `nil`."
  @spec visual(BB.Dsl.Visual.t() | nil) :: Link.visual() | nil
  def visual(nil), do: nil

  def visual(declared) do
    %{
      origin: origin(declared.origin),
      geometry: geometry(declared.geometry),
      material: material(declared.material)
    }
  end

  @doc "Returns a collision of a link."
  @spec collision(BB.Dsl.Collision.t()) :: Link.collision()
  def collision(declared) do
    %{
      name: declared.name,
      origin: origin(declared.origin),
      geometry: geometry(declared.geometry)
    }
  end

  @doc "Returns an origin as a position and roll, pitch, yaw, or `nil`."
  @spec origin(BB.Dsl.Origin.t() | nil) :: Link.origin()
  def origin(nil), do: nil

  def origin(declared) do
    {triple(declared, [:x, :y, :z]), triple(declared, [:roll, :pitch, :yaw])}
  end

  @doc "Returns a shape with its lengths in m, or `nil`."
  @spec geometry(struct() | nil) :: Link.geometry() | nil
  def geometry(nil), do: nil
  def geometry(%BB.Dsl.Box{} = box), do: {:box, Resolved.numbers(box)}
  def geometry(%BB.Dsl.Cylinder{} = cylinder), do: {:cylinder, Resolved.numbers(cylinder)}
  def geometry(%BB.Dsl.Sphere{} = sphere), do: {:sphere, Resolved.numbers(sphere)}

  def geometry(%BB.Dsl.Capsule{radius: radius, height: height}),
    do: {:capsule, %{radius: Resolved.to_si(radius), length: Resolved.to_si(height)}}

  def geometry(%BB.Dsl.Mesh{filename: filename, scale: scale}),
    do: {:mesh, %{filename: filename, scale: scale}}

  defp material(nil), do: nil

  defp material(declared) do
    %{
      name: declared.name,
      color: declared.color && Map.from_struct(declared.color),
      texture: declared.texture && declared.texture.filename
    }
  end

  defp triple(declared, fields),
    do: fields |> Enum.map(&Resolved.to_si(Map.fetch!(declared, &1))) |> List.to_tuple()
end
