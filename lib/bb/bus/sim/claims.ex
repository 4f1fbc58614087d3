defmodule BB.Bus.Sim.Claims do
  @moduledoc """
  Records which robots declare a device at a place of a simulated bus, and decides who may share
  it.

  The processes of simulated buses and of chips of lines use it. A place is an address or a name,
  and has one device. Robots that declare the same device there share it, and it stays until the
  last of them has stopped. A device that the configuration or a test put there stays, and a
  robot's device is left out. The module is pure.

      iex> alias BB.Bus.Sim.Claims
      iex> chip = {BB.Bus.Sim.Mpu6050, source: :motion}
      iex> Claims.check(%{}, 0x68, nil, chip, A)
      :free
      iex> claims = Claims.add(%{}, 0x68, A)
      iex> Claims.check(claims, 0x68, chip, chip, B)
      :shared
      iex> Claims.check(claims, 0x68, chip, {Other, []}, B)
      {:taken, chip, A}
      iex> Claims.check(%{}, 0x68, chip, {Other, []}, B)
      :kept
  """

  @typedoc "An address of an I2C bus, or the name of a device on lines."
  @type place :: term()

  @typedoc "The robots that declare the device at a place."
  @type t :: %{place() => [robot :: module(), ...]}

  @doc """
  Returns what to do with the `device` that a robot declares for a place with the device
  `present`, `nil` for none.

  - `:free`: plug it in;
  - `:shared`: the same device is present;
  - `:kept`: another device is present, which no robot declared, and stays;
  - `{:taken, present, robot}`: another robot declared another device there.
  """
  @spec check(t(), place(), {module(), keyword()} | nil, {module(), keyword()}, module()) ::
          :free | :shared | :kept | {:taken, {module(), keyword()}, module()}
  def check(_claims, _place, nil, _device, _robot), do: :free

  def check(claims, place, present, device, robot) do
    case Map.get(claims, place, []) do
      [] -> :kept
      _robots when present == device -> :shared
      [^robot] -> :shared
      robots -> {:taken, present, hd(robots -- [robot])}
    end
  end

  @doc "Adds a robot to those that declare the device at a place."
  @spec add(t(), place(), module()) :: t()
  def add(claims, place, robot), do: Map.update(claims, place, [robot], &Enum.uniq([robot | &1]))

  @doc "Removes a robot. Returns the other claims, and the places that no robot claims any more."
  @spec drop(t(), module()) :: {t(), [place()]}
  def drop(claims, robot) do
    {claimed, free} =
      claims
      |> Enum.map(fn {place, robots} -> {place, List.delete(robots, robot)} end)
      |> Enum.split_with(fn {_place, robots} -> robots != [] end)

    {Map.new(claimed), Enum.map(free, &elem(&1, 0))}
  end
end
