defmodule BB.Sensor.Conformance.Wires do
  @moduledoc """
  The behaviour of the simulated wires between a driver and its device in a conformance test.

  `BB.Sensor.Conformance` has wires for I2C and GPIO. Implement this behaviour, and name the
  module by `:wires`, for a device on another bus or on none:

      defmodule MyRobot.FileWires do
        @behaviour BB.Sensor.Conformance.Wires

        @impl true
        def start(setting, name, _clock) do
          {:ok, files} = MyRobot.Files.start_link(name, setting.device)
          {files, %{root: MyRobot.Files.root(files)}}
        end

        @impl true
        def options(place), do: [root: place.root]

        # and the other callbacks
      end
  """

  @typedoc "The place of the chip, as the driver's options need it."
  @type place :: %{atom() => term()}

  @doc "Returns the faults that the wires can have."
  @callback faults() :: [atom()]

  @doc """
  Returns the fault with which the device is absent from the start: the bus cannot be opened, or
  nothing answers.
  """
  @callback absence() :: atom()

  @doc "Returns the fault during which the driver still has to stop in time."
  @callback stuck() :: atom()

  @doc "Returns the faults that look like readings until the driver detects them."
  @callback deceptive() :: [atom()]

  @doc "Starts the simulation under the given name, which is unique, linked to the caller."
  @callback start(BB.Sensor.Conformance.Setting.t(), String.t(), BB.Clock.t()) :: {pid(), place()}

  @doc "Returns the driver's options for the place of the chip."
  @callback options(place()) :: keyword()

  @doc "Replaces the chip by another device."
  @callback exchange(place(), {module(), keyword()}) :: :ok

  @doc "Begins a fault."
  @callback break(place(), atom()) :: :ok

  @doc "Ends a fault."
  @callback mend(place(), atom()) :: :ok

  @doc "Returns whether no process has the bus open."
  @callback free?(place()) :: boolean()
end
