defmodule Ganglion.Demo.RealBuses do
  @moduledoc """
  Puts a robot on the machine's own buses, for `bin/demo --real`.
  """

  alias BB.Bus.Linux

  @doc """
  Has the robot use the buses of this machine; `bus` stands for each of its I2C buses, if it is not
  `nil`. `{:error, sentence}` when one of them cannot be opened.
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
  The I2C buses that a robot's components name.

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
