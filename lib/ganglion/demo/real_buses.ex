defmodule Ganglion.Demo.RealBuses do
  @moduledoc """
  Configures Ganglion to use the machine's own buses, for `bin/demo --real`.

  `Ganglion.Demo` calls it before it starts the robot.

      :ok = Ganglion.Demo.RealBuses.use_for(Ganglion.Robot, "i2c-7")
  """

  alias BB.Bus.Linux

  @doc """
  Configures the buses of this machine for the robot.

  A `bus` that is not `nil` replaces each I2C bus of the robot. Returns `{:error, sentence}` if a
  bus cannot be opened.
  """
  @spec use_for(module(), String.t() | nil) :: :ok | {:error, String.t()}
  def use_for(robot, bus) do
    names = names(robot)
    if bus, do: rename(names, bus)

    with :ok <- check(names) do
      Application.put_env(:ganglion, :i2c, Linux.I2C)
      Application.put_env(:ganglion, :gpio, Linux.GPIO)
    end
  end

  @doc """
  Returns the names of the I2C buses that a robot's components use.

      iex> Ganglion.Demo.RealBuses.names(Ganglion.Robot)
      ["i2c-1"]
  """
  @spec names(module()) :: [String.t()]
  def names(robot) do
    for component <- robot.robot().components,
        name = component.options[:bus],
        is_binary(name),
        uniq: true,
        do: name
  end

  defp rename(names, bus) do
    options = Application.get_env(:ganglion, Linux, [])
    renamed = Map.new(names, &{&1, bus})
    Application.put_env(:ganglion, Linux, Keyword.put(options, :names, renamed))
  end

  defp check(names) do
    Enum.find_value(names, :ok, fn name ->
      with :ok <- Linux.check_bus(name), do: nil
    end)
  end
end
