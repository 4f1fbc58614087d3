defmodule BB.Bus.Sim.GPIO.Line do
  @moduledoc """
  One simulated line: a wire with the processor's pin at its near end and devices at its far end.

  `BB.Bus.Sim.GPIO.Chip` has one for each of its lines. The module is pure.

      iex> alias BB.Bus.Sim.GPIO.Line
      iex> line = %Line{} |> Line.host(:input, :pullup) |> Line.drive(:button, 0)
      iex> {line.near, line.far}
      {0, 0}
      iex> line = Line.fault(line, :cut)
      iex> {line.near, line.far}
      {1, 0}
      iex> line |> Line.fault(nil) |> Line.drive(:button, :z) |> Map.fetch!(:near)
      1

  The level of a wire is decided by the first that applies of

  1. a short circuit, to ground or to the supply;
  2. a driver of 0, then a driver of 1. When both drive, 0 wins;
  3. a resistor at the far end (`:pulldown`, `:pullup`), then the pin's own pull, which is weaker;
  4. its last level. A wire without a driver floats.

  A wire that is cut has two levels: the pin has only its own pull, the devices have only their
  drives.
  """

  defstruct near: 0, far: 0, host: :input, pull: :none, drivers: %{}, fault: nil, noise: nil

  @typedoc "A level."
  @type level :: 0 | 1

  @typedoc "How a driver acts: it drives a level, pulls by a resistor, or lets go (`:z`)."
  @type drive :: level() | :z | :pullup | :pulldown

  @typedoc "The setting of the pin. `:z` is an open drain at 1 or an open source at 0."
  @type host :: :input | {:output, level() | :z}

  @typedoc """
  A fault of a line:

  - `:cut`: the wire is cut;
  - `{:short, level}`: the wire has a short circuit to ground or to the supply;
  - `{:storm, hertz}`: noise changes the level at the pin so many times a second;
  - `:busy`: another program of the machine has taken it, so its handles are closed and it cannot
    be opened.
  """
  @type fault :: :cut | {:short, level()} | {:storm, hertz :: pos_integer()} | :busy

  @typedoc "A line, with its level at the pin (`:near`) and at the devices (`:far`)."
  @type t :: %__MODULE__{
          near: level(),
          far: level(),
          host: host(),
          pull: :none | :pullup | :pulldown,
          drivers: %{term() => drive()},
          fault: fault() | nil,
          noise: level() | nil
        }

  @doc "Returns whether a term is a `t:drive/0`."
  defguard is_drive(drive) when drive in [0, 1, :z, :pullup, :pulldown]

  @doc "Sets the pin, and its pull. `:not_set` keeps the pull."
  @spec host(t(), host(), :none | :pullup | :pulldown | :not_set) :: t()
  def host(line, host, :not_set), do: host(line, host, line.pull)
  def host(line, host, pull), do: put_levels(%{line | host: host, pull: pull})

  @doc "Sets the drive of a driver at the far end."
  @spec drive(t(), term(), drive()) :: t()
  def drive(line, driver, :z), do: put_levels(%{line | drivers: Map.delete(line.drivers, driver)})

  def drive(line, driver, drive) when is_drive(drive),
    do: put_levels(%{line | drivers: Map.put(line.drivers, driver, drive)})

  @doc "Sets the fault, or clears it with `nil`."
  @spec fault(t(), fault() | nil) :: t()
  def fault(line, fault), do: put_levels(%{line | fault: fault, noise: nil})

  @doc "Inverts the level at the pin, as noise does."
  @spec disturb(t()) :: t()
  def disturb(line), do: put_levels(%{line | noise: 1 - line.near})

  @doc "Returns the fault, or raises `ArgumentError`."
  @spec check_fault!(fault()) :: fault()
  def check_fault!(fault) when fault in [:cut, :busy, {:short, 0}, {:short, 1}], do: fault
  def check_fault!({:storm, hz} = fault) when is_integer(hz) and hz > 0, do: fault

  def check_fault!(other) do
    raise ArgumentError,
          "expected a fault: :cut, {:short, 0}, {:short, 1}, {:storm, hertz} or :busy, " <>
            "got: #{inspect(other)}"
  end

  defp put_levels(%{fault: {:short, level}} = line), do: %{line | near: level, far: level}

  defp put_levels(%{fault: :cut} = line),
    do: %{line | near: level(line, [:host]), far: level(line, [:drivers])}

  defp put_levels(%{noise: nil} = line) do
    level = level(line, [:host, :drivers])
    %{line | near: level, far: level}
  end

  defp put_levels(line), do: %{line | near: line.noise, far: level(line, [:host, :drivers])}

  defp level(line, ends) do
    drives = Enum.flat_map(ends, &drives(line, &1))
    last = if :host in ends, do: line.near, else: line.far

    case Enum.min_by(drives, &rank/1, fn -> :z end) do
      level when level in [0, 1] -> level
      pull when pull in [:pulldown, {:pin, :pulldown}] -> 0
      pull when pull in [:pullup, {:pin, :pullup}] -> 1
      _floating -> last
    end
  end

  defp drives(line, :drivers), do: Map.values(line.drivers)
  defp drives(%{host: {:output, level}} = line, :host), do: [level, {:pin, line.pull}]
  defp drives(line, :host), do: [{:pin, line.pull}]

  defp rank(0), do: 0
  defp rank(1), do: 1
  defp rank(:pulldown), do: 2
  defp rank(:pullup), do: 3
  defp rank({:pin, pull}) when pull != :none, do: 4
  defp rank(_nothing), do: 5
end
