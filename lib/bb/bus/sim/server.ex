defmodule BB.Bus.Sim.Server do
  @moduledoc """
  The process of one simulated I2C bus.

  `BB.Bus.Sim` and `BB.Bus.Sim.I2C` call it. Transfers wait in a queue until the bus is free.
  Orders to the simulation (unplug, fault, …) take effect at once. `BB.Bus.Sim.Place` decides what
  a device answers.
  """
  @moduledoc no_example: "internal: BB.Bus.Sim and BB.Bus.Sim.I2C are its interface"

  use GenServer
  use BB.Process.Tolerant

  alias BB.Bus.Sim.{Claims, Directory, Interrupts, Place}

  @registry BB.Bus.Sim.Registry
  @options [:devices, :clock, :clock_hz]
  @no_such_device 19
  @orders [:unplug, :replug, :clear]
  @ns_per_ms 1_000_000

  @typedoc "A transfer, with the settings of its handle."
  @type transfer :: %{
          address: non_neg_integer(),
          request: Place.request(),
          retries: non_neg_integer(),
          timeout_ms: pos_integer()
        }

  @doc false
  def start_link({name, opts}),
    do: Directory.start_link(__MODULE__, {name, opts}, @registry, name)

  @doc "Returns the names of the buses that run, sorted."
  @spec names() :: [String.t()]
  def names, do: Directory.names(@registry)

  @doc "Returns the process of a bus."
  @spec fetch(String.t()) :: {:ok, pid()} | :error
  def fetch(name), do: Directory.fetch(@registry, name)

  @doc "Gives a bus an order. Returns `{:error, :bus_not_found}` when it does not run."
  @spec call(String.t(), order :: term()) :: term()
  def call(name, order) when is_binary(name) do
    GenServer.call(Directory.via(@registry, name), order, :infinity)
  catch
    # A bus that ends while it is asked is gone too.
    :exit, {reason, _} when reason in [:noproc, :normal, :shutdown, :killed] ->
      {:error, :bus_not_found}
  end

  @doc "Makes a transfer. A bus that has ended since it was opened returns the kernel's ENODEV."
  @spec transfer(pid(), transfer()) :: :ok | {:ok, binary()} | {:error, term()}
  def transfer(pid, transfer) do
    GenServer.call(pid, {:transfer, transfer}, :infinity)
  catch
    :exit, _ -> {:error, {:errno, @no_such_device}}
  end

  @impl GenServer
  def init({name, opts}) do
    check_options!(opts)
    clock = clock!(Keyword.get(opts, :clock, :real))

    bus = %{
      places: %{},
      claims: %{},
      clock: clock,
      interrupts: if(is_function(clock), do: nil, else: Interrupts.new(name, clock)),
      clock_hz: opts[:clock_hz],
      stuck?: false,
      free_at_ns: monotonic_ns(),
      holder: nil,
      queue: :queue.new()
    }

    plug_all(Enum.to_list(opts[:devices] || []), bus)
  end

  @impl GenServer
  def handle_call({:transfer, transfer}, from, bus),
    do: {:noreply, run_queue(%{bus | queue: :queue.in({from, transfer}, bus.queue)})}

  def handle_call(:devices, _from, bus), do: {:reply, Map.new(bus.places, &describe/1), bus}

  def handle_call({:stuck, stuck?}, _from, bus), do: {:reply, :ok, %{bus | stuck?: stuck?}}

  def handle_call({:plug, address, device}, _from, bus) do
    case plug(address, device, bus) do
      {:ok, bus} -> {:reply, :ok, bus}
      error -> {:reply, error, bus}
    end
  end

  def handle_call({:wire, address, device, robot}, _from, bus) do
    case Claims.check(bus.claims, address, present(bus.places[address]), device, robot) do
      :free -> wire(plug(address, device, bus), address, robot, bus)
      :shared -> {:reply, :ok, claim(bus, address, robot)}
      refused -> {:reply, refused, bus}
    end
  end

  def handle_call({:unwire, robot}, _from, bus) do
    {claims, free} = Claims.drop(bus.claims, robot)

    bus =
      for address <- free, reduce: %{bus | claims: claims} do
        bus -> put_place(bus, address, Place.unplug(bus.places[address]))
      end

    {:reply, :ok, bus}
  end

  def handle_call({order, address}, _from, bus) when order in @orders,
    do: change_place(order, address, bus)

  def handle_call({:fault, address, fault}, _from, bus),
    do: change_place({:fault, fault}, address, bus)

  @impl GenServer
  def handle_info(:free, %{holder: {from, answer}} = bus) do
    GenServer.reply(from, answer)
    {:noreply, run_queue(%{bus | holder: nil})}
  end

  def handle_info({:pulse, address}, bus),
    do: {:noreply, put_place(bus, address, bus.places[address])}

  # Transfers: one holds the bus at a time.

  defp run_queue(%{holder: nil} = bus) do
    case :queue.out(bus.queue) do
      {:empty, _} ->
        bus

      {{:value, {from, transfer}}, queue} ->
        run_queue(run_transfer(from, transfer, %{bus | queue: queue}))
    end
  end

  defp run_queue(bus), do: bus

  defp run_transfer(from, transfer, bus) do
    place = bus.places[transfer.address]
    {answer, cost_ns, place} = attempt(place, transfer, transfer.retries, 0, bus)
    bus = if place, do: put_place(bus, transfer.address, place), else: bus
    reply(from, answer, cost_ns, bus)
  end

  defp attempt(place, transfer, retries, spent_ns, bus) do
    {answer, held_ms, place} = attempt_once(place, transfer, bus)
    spent_ns = spent_ns + held_ms * @ns_per_ms + cost_ns(answer, transfer, bus.clock_hz)

    if retries > 0 and match?({:error, _}, answer),
      do: attempt(place, transfer, retries - 1, spent_ns, bus),
      else: {answer, spent_ns, place}
  end

  defp attempt_once(place, transfer, %{stuck?: true}),
    do: {{:error, :timeout}, transfer.timeout_ms, place}

  defp attempt_once(place, transfer, bus),
    do: Place.attempt(place, transfer.request, transfer.timeout_ms, now_ns(bus))

  defp cost_ns({:error, :timeout}, _transfer, _clock_hz), do: 0
  defp cost_ns(_answer, _transfer, nil), do: 0

  defp cost_ns(answer, transfer, clock_hz),
    do: div(9 * bytes(answer, transfer.request) * 1_000_000_000, clock_hz)

  defp bytes({:error, _}, _request), do: 1
  defp bytes(_answer, {data, nil}), do: 1 + byte_size(data)
  defp bytes(_answer, {nil, count}), do: 1 + count
  defp bytes(_answer, {data, count}), do: 2 + byte_size(data) + count

  defp reply(from, answer, 0, bus) do
    GenServer.reply(from, answer)
    bus
  end

  defp reply(from, answer, cost_ns, bus) do
    now_ns = monotonic_ns()
    free_at_ns = max(now_ns, bus.free_at_ns) + cost_ns
    bus = %{bus | free_at_ns: free_at_ns}

    if free_at_ns - now_ns < @ns_per_ms do
      reply(from, answer, 0, bus)
    else
      Process.send_after(self(), :free, div(free_at_ns - now_ns + @ns_per_ms - 1, @ns_per_ms))
      %{bus | holder: {from, answer}}
    end
  end

  # Orders to the simulation.

  defp change_place(order, address, bus) do
    with {:ok, place} <- fetch_place(bus, address), {:ok, place} <- change(order, place, bus) do
      {:reply, :ok, put_place(bus, address, place)}
    else
      error -> {:reply, error, bus}
    end
  end

  defp fetch_place(bus, address) do
    with :error <- Map.fetch(bus.places, address), do: {:error, :no_device}
  end

  defp change(:unplug, place, _bus), do: {:ok, Place.unplug(place)}
  defp change(:replug, place, bus), do: Place.replug(place, now_ns(bus))
  defp change(:clear, place, _bus), do: {:ok, Place.clear_fault(place)}
  defp change({:fault, fault}, place, bus), do: Place.put_fault(place, fault, now_ns(bus))

  defp plug(address, device, bus) do
    case bus.places[address] do
      %{plugged?: true} ->
        {:error, :address_taken}

      _ ->
        with {:ok, place} <- Place.new(device, now_ns(bus)),
             do: {:ok, put_place(bus, address, place)}
    end
  end

  defp plug_all([], bus), do: {:ok, bus}

  defp plug_all([{address, device} | rest], bus) do
    case plug(address, device, bus) do
      {:ok, bus} -> plug_all(rest, bus)
      {:raise, exception} -> {:stop, exception}
      {:error, reason} -> {:stop, {address, reason}}
    end
  end

  defp present(%{plugged?: true} = place), do: {place.module, place.opts}
  defp present(_absent), do: nil

  defp wire({:ok, bus}, address, robot, _before), do: {:reply, :ok, claim(bus, address, robot)}
  defp wire(error, _address, _robot, bus), do: {:reply, error, bus}

  defp claim(bus, address, robot), do: %{bus | claims: Claims.add(bus.claims, address, robot)}

  defp describe({address, place}),
    do: {address, Map.take(place, [:module, :plugged?, :fault, :broken?, :transfers])}

  # Each change of a device can change the pulses of its interrupt pin.
  defp put_place(%{interrupts: nil} = bus, address, place), do: put_in(bus.places[address], place)

  defp put_place(bus, address, place) do
    interrupts = Interrupts.follow(bus.interrupts, address, place)
    %{bus | places: Map.put(bus.places, address, place), interrupts: interrupts}
  end

  defp check_options!(opts) do
    case Keyword.keys(opts) -- @options do
      [] ->
        :ok

      unknown ->
        raise ArgumentError,
              "unknown options #{inspect(unknown)} of a bus, expected: #{inspect(@options)}"
    end
  end

  defp clock!(clock)
       when is_function(clock, 0) or clock == :real or is_struct(clock, BB.Clock.Stepped),
       do: clock

  defp clock!(other) do
    raise ArgumentError,
          "expected clock: a BB.Clock or a function that returns nanoseconds, " <>
            "got: #{inspect(other)}"
  end

  defp now_ns(%{clock: clock}) when is_function(clock), do: clock.()
  defp now_ns(bus), do: BB.Clock.now_ns(bus.clock)

  defp monotonic_ns, do: System.monotonic_time(:nanosecond)
end
