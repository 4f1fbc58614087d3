defmodule BB.Sensor.Conformance.Wires do
  @moduledoc "What a driver's chip hangs on in a conformance test, and how that breaks."

  @typedoc "Where the chip is."
  @type place :: %{atom() => term()}

  @doc "The faults that there are."
  @callback faults() :: [atom()]

  @doc "The fault with which its bus cannot be opened, or nothing answers there, from the start on."
  @callback absence() :: atom()

  @doc "The fault with which it is to stop all the same."
  @callback stuck() :: atom()

  @doc "Faults that look like readings until they are noticed."
  @callback deceptive() :: [atom()]

  @doc "Starts what is simulated, linked to the caller, under a name that is free."
  @callback start(BB.Sensor.Conformance.Setting.t(), String.t(), BB.Clock.t()) :: {pid(), place()}

  @doc "The driver's options that say where the chip is."
  @callback options(place()) :: keyword()

  @doc "Puts another device in the place of the chip."
  @callback exchange(place(), {module(), keyword()}) :: :ok

  @doc "Begins a fault."
  @callback break(place(), atom()) :: :ok

  @doc "Ends it."
  @callback mend(place(), atom()) :: :ok

  @doc "Whether nobody has it open."
  @callback free?(place()) :: boolean()
end
