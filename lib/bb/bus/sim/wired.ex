defmodule BB.Bus.Sim.Wired do
  @moduledoc """
  Which robots have wired a device to a simulated bus: who may share a place with whom. Pure.

  A place, an address or a name, has one device. Robots that declare the same device there share
  it, and it stays until the last of them has gone. A device that no robot has put there, but the
  configuration or a test, goes before what robots declare.

      iex> alias BB.Bus.Sim.Wired
      iex> chip = {BB.Bus.Sim.Mpu6050, source: :motion}
      iex> Wired.ask(%{}, 0x68, nil, chip, A)
      :free
      iex> wired = Wired.add(%{}, 0x68, A)
      iex> {Wired.ask(wired, 0x68, chip, chip, B), Wired.ask(wired, 0x68, chip, {Other, []}, B)}
      {:shared, {:taken, chip, A}}
      iex> Wired.ask(%{}, 0x68, chip, {Other, []}, B)
      :kept
  """

  @typedoc "An address of an I2C bus, or the name of a device on lines."
  @type place :: term()

  @type t :: %{place() => [robot :: module(), ...]}

  @doc """
  What becomes of a device that a robot declares for a place where there is `present`, or `nil`:
  it is to be plugged in (`:free`), it is there already (`:shared`), another is there and stays
  (`:kept`), or another robot has another one there.
  """
  @spec ask(t(), place(), {module(), keyword()} | nil, {module(), keyword()}, module()) ::
          :free | :shared | :kept | {:taken, {module(), keyword()}, module()}
  def ask(_wired, _place, nil, _device, _robot), do: :free

  def ask(wired, place, present, device, robot) do
    case Map.get(wired, place, []) do
      [] -> :kept
      _robots when present == device -> :shared
      [^robot] -> :shared
      robots -> {:taken, present, hd(robots -- [robot])}
    end
  end

  @doc "A robot has a device at a place."
  @spec add(t(), place(), module()) :: t()
  def add(wired, place, robot), do: Map.update(wired, place, [robot], &Enum.uniq([robot | &1]))

  @doc "A robot has gone: what is wired from now on, and the places that nobody uses any more."
  @spec drop(t(), module()) :: {t(), [place()]}
  def drop(wired, robot) do
    {left, gone} =
      wired
      |> Enum.map(fn {place, robots} -> {place, robots, List.delete(robots, robot)} end)
      |> Enum.split_with(fn {_place, _before, robots} -> robots != [] end)

    {Map.new(left, fn {place, _, robots} -> {place, robots} end), Enum.map(gone, &elem(&1, 0))}
  end
end
