defmodule BB.Bus.Sim.GPIO.Line do
  @moduledoc """
  One simulated line: a wire with the processor's pin at its near end and devices at its far end. Pure.

  Who drives the wire decides its level:

  1. a short circuit, to ground or to the supply;
  2. whoever drives it low, then whoever drives it high (two who fight: low wins);
  3. a resistor at the far end (`:pulldown`, `:pullup`), then the pin's own pull, which is weaker;
  4. nobody: it floats, and keeps the level that it had.

  A wire that is cut has two levels: the pin sees only its own pull, the devices only themselves.

      iex> alias BB.Bus.Sim.GPIO.Line
      iex> line = %Line{} |> Line.host(:input, :pullup) |> Line.drive(:button, 0)
      iex> {line.near, line.far}
      {0, 0}
      iex> line = Line.fault(line, :cut)
      iex> {line.near, line.far}
      {1, 0}
      iex> line |> Line.fault(nil) |> Line.drive(:button, :z) |> Map.fetch!(:near)
      1
  """

  defstruct near: 0, far: 0, host: :input, pull: :none, drivers: %{}, fault: nil, noise: nil

  @type level :: 0 | 1

  @typedoc "What one who is connected does: drives it, pulls it by a resistor, or lets go (`:z`)."
  @type drive :: level() | :z | :pullup | :pulldown

  @typedoc "What the processor's pin does; an output that lets go is an open drain at 1 or an open source at 0."
  @type host :: :input | {:output, level() | :z}

  @typedoc """
  What is wrong with it: the wire is cut or short-circuited; noise changes its level at the pin so many times a second; or another
  program of the machine has taken it, so that whoever had it open has lost it and nobody here can open it.
  """
  @type fault :: :cut | {:short, level()} | {:storm, hertz :: pos_integer()} | :busy

  @type t :: %__MODULE__{
          near: level(),
          far: level(),
          host: host(),
          pull: :none | :pullup | :pulldown,
          drivers: %{term() => drive()},
          fault: fault() | nil,
          noise: level() | nil
        }

  @doc "Whether a term is a `t:drive/0`."
  defguard is_drive(drive) when drive in [0, 1, :z, :pullup, :pulldown]

  @doc "The pin's direction and pull are set; a pull of `:not_set` stays as it was."
  @spec host(t(), host(), :none | :pullup | :pulldown | :not_set) :: t()
  def host(line, host, :not_set), do: host(line, host, line.pull)
  def host(line, host, pull), do: settle(%{line | host: host, pull: pull})

  @doc "Somebody at the far end drives it."
  @spec drive(t(), term(), drive()) :: t()
  def drive(line, driver, :z), do: settle(%{line | drivers: Map.delete(line.drivers, driver)})

  def drive(line, driver, drive) when is_drive(drive),
    do: settle(%{line | drivers: Map.put(line.drivers, driver, drive)})

  @doc "Something is wrong with it from now on, or (`nil`) nothing any more."
  @spec fault(t(), fault() | nil) :: t()
  def fault(line, fault), do: settle(%{line | fault: fault, noise: nil})

  @doc "Noise turns the level that the pin sees."
  @spec disturb(t()) :: t()
  def disturb(line), do: settle(%{line | noise: 1 - line.near})

  @doc "The fault itself; raises `ArgumentError` when it is none."
  @spec check_fault!(fault()) :: fault()
  def check_fault!(fault) when fault in [:cut, :busy, {:short, 0}, {:short, 1}], do: fault
  def check_fault!({:storm, hz} = fault) when is_integer(hz) and hz > 0, do: fault

  def check_fault!(other) do
    raise ArgumentError,
          "expected a fault: :cut, {:short, 0}, {:short, 1}, {:storm, hertz} or :busy, got: #{inspect(other)}"
  end

  defp settle(%{fault: {:short, level}} = line), do: %{line | near: level, far: level}

  defp settle(%{fault: :cut} = line),
    do: %{line | near: level(line, [:host]), far: level(line, [:drivers])}

  defp settle(%{noise: nil} = line) do
    level = level(line, [:host, :drivers])
    %{line | near: level, far: level}
  end

  defp settle(line), do: %{line | near: line.noise, far: level(line, [:host, :drivers])}

  defp level(line, ends) do
    drives = Enum.flat_map(ends, &drives(line, &1))
    last = if :host in ends, do: line.near, else: line.far

    case Enum.min_by(drives, &rank/1, fn -> :z end) do
      level when level in [0, 1] -> level
      pull when pull in [:pulldown, {:pin, :pulldown}] -> 0
      pull when pull in [:pullup, {:pin, :pullup}] -> 1
      _nobody -> last
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
