defmodule BB.Bus.Sim.GPIO.Server do
  @moduledoc """
  The process of one simulated chip of lines.

  `BB.Bus.Sim.GPIO` and `BB.Bus.Sim.Lines` call it. It passes the time to `BB.Bus.Sim.GPIO.Chip`
  and `BB.Bus.Sim.GPIO.Handles`, which decide what happens, and has a timer for the chip's next
  event. A request always finds the lines as they are at its time, even if the timer is late.
  """
  @moduledoc no_example: "internal: BB.Bus.Sim.GPIO and BB.Bus.Sim.Lines are its interface"

  use GenServer
  use BB.Process.Tolerant

  alias BB.Bus.Sim.{Claims, Directory}
  alias BB.Bus.Sim.GPIO.{Chip, Handles}
  alias BB.Clock

  @registry BB.Bus.Sim.GPIO.Registry
  @options [:lines, :devices, :labels, :label, :clock, :timestamp_offset_ns]

  @doc false
  def start_link({name, opts}),
    do: Directory.start_link(__MODULE__, {name, opts}, @registry, name)

  @doc "Returns the names of the chips that run, sorted."
  @spec names() :: [String.t()]
  def names, do: Directory.names(@registry)

  @doc "Returns the process of a chip."
  @spec fetch(String.t()) :: {:ok, pid()} | :error
  def fetch(name), do: Directory.fetch(@registry, name)

  @doc "Calls a chip, given by its name or its process. Returns `default` when it does not run."
  @spec call(String.t() | GenServer.server(), term(), term()) :: term()
  def call(chip, request, default \\ {:error, :not_found})

  def call(name, request, default) when is_binary(name),
    do: call(Directory.via(@registry, name), request, default)

  def call(chip, request, default) do
    GenServer.call(chip, request, :infinity)
  catch
    :exit, _reason -> default
  end

  @impl GenServer
  def init({name, opts}) do
    # Hardware does not wait for the robot's computations.
    Process.flag(:priority, :high)
    check_options!(opts)
    clock = opts[:clock] || :real
    devices = Enum.to_list(opts[:devices] || [])

    case plug_all(devices, Chip.new(name, opts), Clock.now_ns(clock)) do
      {:ok, chip} -> {:ok, set_timer(%{chip: chip, clock: clock, claims: %{}, timer: nil})}
      {:raise, exception} -> {:stop, exception}
    end
  end

  defp plug_all([], chip, _now_ns), do: {:ok, chip}

  defp plug_all([{name, device} | rest], chip, now_ns) do
    with {:ok, chip} <- Chip.plug(chip, name, device, now_ns), do: plug_all(rest, chip, now_ns)
  end

  @impl GenServer
  def handle_call(request, {pid, _tag}, state) do
    now_ns = Clock.now_ns(state.clock)
    state = %{state | chip: Chip.advance(state.chip, now_ns)}
    {reply, state} = handle_request(request, pid, now_ns, state)
    {:reply, reply, set_timer(state)}
  end

  @impl GenServer
  def handle_info(:due, state) do
    chip = Chip.advance(state.chip, Clock.now_ns(state.clock))
    {:noreply, set_timer(%{state | chip: chip, timer: nil})}
  end

  def handle_info({:DOWN, monitor, :process, _pid, _reason}, state) do
    chip = Handles.owner_down(state.chip, monitor, Clock.now_ns(state.clock))
    {:noreply, set_timer(%{state | chip: chip})}
  end

  # Requests of drivers, through BB.Bus.Sim.GPIO.

  defp handle_request(:identifiers, _pid, _now_ns, state),
    do: {Chip.identifiers(state.chip), state}

  defp handle_request({:open, spec, offsets, direction, opts}, pid, now_ns, state) do
    case Handles.open(state.chip, spec, offsets, direction, opts, pid, now_ns) do
      {:ok, ref, chip} -> {{:ok, ref}, %{state | chip: chip}}
      {:error, reason} -> {{:error, reason}, state}
    end
  end

  defp handle_request({:close, ref}, _pid, now_ns, state),
    do: put({:ok, Handles.close(state.chip, ref, now_ns)}, state)

  defp handle_request({:force_close, offset}, _pid, now_ns, state),
    do: put({:ok, Handles.close_all(state.chip, offset, now_ns)}, state)

  defp handle_request({:status, offset}, _pid, _now_ns, state),
    do: {Handles.status(state.chip, offset), state}

  defp handle_request({:handle, ref, request}, _pid, now_ns, state) do
    {reply, chip} = Handles.call(state.chip, ref, request, now_ns)
    {reply, %{state | chip: chip}}
  end

  # Requests of tests and people, through BB.Bus.Sim.Lines.

  defp handle_request({:describe, offset}, _pid, _now_ns, state),
    do: {Chip.describe(state.chip, offset), state}

  defp handle_request({:drive, offset, driver, drive, nil}, _pid, now_ns, state),
    do: put({:ok, Chip.drive(state.chip, offset, driver, drive, now_ns)}, state)

  defp handle_request({:drive, offset, driver, drive, time_ns}, _pid, now_ns, state) do
    chip = Chip.schedule_drive(state.chip, offset, driver, drive, time_ns)
    put({:ok, Chip.advance(chip, now_ns)}, state)
  end

  defp handle_request({:release, offset, driver}, _pid, now_ns, state),
    do: put({:ok, Chip.release(state.chip, offset, driver, now_ns)}, state)

  defp handle_request({:fault, offset, fault}, _pid, now_ns, state) do
    chip = if fault == :busy, do: Handles.close_all(state.chip, offset, now_ns), else: state.chip
    put({:ok, Chip.put_fault(chip, offset, fault, now_ns)}, state)
  end

  defp handle_request({:plug, name, device}, _pid, now_ns, state) do
    if Chip.present(state.chip, name),
      do: {{:error, :name_taken}, state},
      else: state.chip |> Chip.plug(name, device, now_ns) |> put(state)
  end

  defp handle_request({:unplug, name}, _pid, now_ns, state),
    do: state.chip |> Chip.unplug(name, now_ns) |> put(state)

  defp handle_request({:replug, name}, _pid, now_ns, state),
    do: state.chip |> Chip.replug(name, now_ns) |> put(state)

  defp handle_request({:tell, name, order}, _pid, now_ns, state),
    do: state.chip |> Chip.order(name, order, now_ns) |> put(state)

  defp handle_request(:devices, _pid, _now_ns, state), do: {Chip.devices(state.chip), state}

  # Requests of robots, through BB.Bus.Sim.Wiring.

  defp handle_request({:wire, name, device, robot}, _pid, now_ns, state) do
    case Claims.check(state.claims, name, Chip.present(state.chip, name), device, robot) do
      :free -> state.chip |> Chip.plug(name, device, now_ns) |> put(state) |> claim(name, robot)
      :shared -> claim({:ok, state}, name, robot)
      refused -> {refused, state}
    end
  end

  defp handle_request({:unwire, robot}, _pid, now_ns, state) do
    {claims, free} = Claims.drop(state.claims, robot)

    for name <- free, reduce: {:ok, %{state | claims: claims}} do
      {:ok, state} -> state.chip |> Chip.unplug(name, now_ns) |> put(state)
    end
  end

  defp handle_request(_unknown, _pid, _now_ns, state), do: {{:error, :not_implemented}, state}

  defp put({:ok, chip}, state), do: {:ok, %{state | chip: chip}}
  defp put(refused, state), do: {refused, state}

  defp claim({:ok, state}, name, robot),
    do: {:ok, %{state | claims: Claims.add(state.claims, name, robot)}}

  defp claim(refused, _name, _robot), do: refused

  # The timer of the next event.

  defp set_timer(%{timer: timer} = state) do
    case {Chip.next_ns(state.chip), timer} do
      {same, {same, _ref}} -> state
      {nil, nil} -> state
      {next_ns, timer} -> %{state | timer: start_timer(state.clock, next_ns, timer)}
    end
  end

  defp start_timer(clock, next_ns, {_time_ns, ref}) do
    Clock.cancel(clock, ref)
    start_timer(clock, next_ns, nil)
  end

  defp start_timer(_clock, nil, nil), do: nil

  defp start_timer(clock, next_ns, nil),
    do: {next_ns, Clock.send_at(clock, next_ns, self(), :due)}

  defp check_options!(opts) do
    case Keyword.keys(opts) -- @options do
      [] ->
        :ok

      unknown ->
        raise ArgumentError,
              "unknown options #{inspect(unknown)} of a chip, expected: #{inspect(@options)}"
    end
  end
end
