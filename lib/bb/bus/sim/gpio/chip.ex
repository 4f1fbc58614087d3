defmodule BB.Bus.Sim.GPIO.Chip do
  @moduledoc """
  The process that is one simulated controller of lines. Used through `BB.Bus.Sim.GPIO` and `BB.Bus.Sim.Lines`.
  """
  use GenServer
  use BB.Process.Tolerant

  alias BB.Bus.Sim.{Directory, Wired}
  alias BB.Bus.Sim.GPIO.{Agenda, Handle, Line, Part}
  alias BB.Clock

  @registry BB.Bus.Sim.GPIO.Registry
  @options [:lines, :devices, :labels, :label, :clock, :timestamp_offset_ns]

  @type offset :: non_neg_integer()

  @doc false
  def start_link({name, opts}),
    do: Directory.start_link(__MODULE__, {name, opts}, @registry, name)

  @doc "The names of the chips that run now, sorted."
  @spec names() :: [String.t()]
  def names, do: Directory.names(@registry)

  @doc "The process of a chip."
  @spec fetch(String.t()) :: {:ok, pid()} | :error
  def fetch(name), do: Directory.fetch(@registry, name)

  @doc "Asks a chip, by its name or its process; `default` where it does not run."
  @spec ask(String.t() | GenServer.server(), term(), term()) :: term()
  def ask(chip, request, default \\ {:error, :not_found})

  def ask(name, request, default) when is_binary(name), do: ask(via(name), request, default)

  def ask(chip, request, default) do
    GenServer.call(chip, request, :infinity)
  catch
    :exit, _reason -> default
  end

  defp via(name), do: Directory.via(@registry, name)

  @impl GenServer
  def init({name, opts}) do
    # Hardware does not queue behind what the robot computes.
    Process.flag(:priority, :high)
    check_options!(opts)
    clock = opts[:clock] || :real

    chip = %{
      name: name,
      count: opts[:lines] || 54,
      label: opts[:label] || name,
      labels: Map.new(opts[:labels] || %{}),
      clock: clock,
      offset_ns: opts[:timestamp_offset_ns] || 0,
      lines: %{},
      handles: %{},
      parts: %{},
      wired: %{},
      agenda: Agenda.new(),
      timer: nil
    }

    plug_all(Enum.to_list(opts[:devices] || []), chip)
  end

  # Whoever asks finds the lines as they are now, although a timer may be late.
  @impl GenServer
  def handle_call(request, from, chip), do: serve(request, from, happen(chip))

  # What the processor's programs ask.

  defp serve(:identifiers, _from, chip) do
    {:reply, for(offset <- 0..(chip.count - 1), do: identifiers(chip, offset)), chip}
  end

  defp serve({:open, spec, offsets, direction, opts}, {pid, _}, chip) do
    held = for {ref, handle} <- chip.handles, handle.offsets -- offsets != handle.offsets, do: ref

    cond do
      Enum.any?(offsets, &(&1 not in 0..(chip.count - 1))) ->
        {:reply, {:error, :einval}, chip}

      Enum.any?(offsets, &match?(%{fault: :busy}, line(chip, &1))) ->
        {:reply, {:error, :already_open}, chip}

      held != [] and opts[:on_busy] != :take_over ->
        {:reply, {:error, :already_open}, chip}

      true ->
        open(Enum.reduce(held, chip, &close(&2, &1)), spec, offsets, direction, opts, pid)
    end
  end

  defp serve({:close, ref}, _from, chip), do: chip |> close(ref) |> reply(:ok)

  defp serve({:force_close, offset}, _from, chip),
    do: chip |> close_all(offset) |> reply(:ok)

  defp serve({:status, offset}, _from, chip) when offset < chip.count,
    do: {:reply, {:ok, status(chip, offset)}, chip}

  defp serve({:status, _offset}, _from, chip), do: {:reply, {:error, :einval}, chip}

  defp serve({:handle, ref, request}, _from, chip) do
    case chip.handles do
      %{^ref => handle} -> operate(request, handle, ref, chip)
      _closed -> {:reply, {:error, :ebadf}, chip}
    end
  end

  # Orders to the simulation.

  defp serve({:describe, offset}, _from, chip) do
    line = line(chip, offset)
    open? = Enum.any?(chip.handles, fn {_ref, handle} -> offset in handle.offsets end)
    levels = %{near: line.near, far: line.far, fault: line.fault, open?: open?}
    {:reply, levels, chip}
  end

  defp serve({:drive, offset, driver, drive, nil}, _from, chip),
    do: chip |> drive(offset, driver, drive, now_ns(chip)) |> reply(:ok)

  defp serve({:drive, offset, driver, drive, time_ns}, _from, chip) do
    agenda = Agenda.put(chip.agenda, time_ns, {:driver, offset, driver}, drive)
    %{chip | agenda: agenda} |> happen() |> reply(:ok)
  end

  defp serve({:release, offset, driver}, _from, chip) do
    %{chip | agenda: Agenda.drop(chip.agenda, {:driver, offset, driver})}
    |> drive(offset, driver, :z, now_ns(chip))
    |> reply(:ok)
  end

  defp serve({:fault, offset, fault}, _from, chip) do
    now_ns = now_ns(chip)
    chip = if fault == :busy, do: close_all(chip, offset), else: chip
    chip = %{chip | agenda: Agenda.drop(chip.agenda, {:storm, offset})}
    chip = change(chip, offset, &Line.fault(&1, fault), now_ns, nil)
    chip |> storm(offset, fault, now_ns) |> reply(:ok)
  end

  defp serve({:plug, name, device}, _from, chip) do
    case chip.parts do
      %{^name => %{plugged?: true}} -> {:reply, {:error, :name_taken}, chip}
      _free -> plugged(plug(name, device, chip), chip)
    end
  end

  defp serve({:wire, name, device, robot}, _from, chip) do
    case Wired.ask(chip.wired, name, present(chip.parts[name]), device, robot) do
      :free -> wire(plug(name, device, chip), name, robot, chip)
      :shared -> chip |> wired(name, robot) |> reply(:ok)
      other -> {:reply, other, chip}
    end
  end

  defp serve({:unwire, robot}, _from, chip) do
    {wired, gone} = Wired.drop(chip.wired, robot)

    for name <- gone, reduce: %{chip | wired: wired} do
      chip -> pull(chip, name)
    end
    |> reply(:ok)
  end

  defp serve({order, name}, _from, chip) when order in [:unplug, :replug] do
    case chip.parts do
      %{^name => part} -> obey(order, name, part, chip)
      _none -> {:reply, {:error, :no_device}, chip}
    end
  end

  defp serve({:tell, name, order}, _from, chip) do
    case chip.parts do
      %{^name => %{plugged?: true, broken?: false} = part} -> told(name, part, order, chip)
      _none -> {:reply, {:error, :no_device}, chip}
    end
  end

  defp serve(:devices, _from, chip) do
    devices = Map.new(chip.parts, fn {name, part} -> {name, describe(part)} end)
    {:reply, devices, chip}
  end

  defp serve(_unknown, _from, chip), do: {:reply, {:error, :not_implemented}, chip}

  @impl GenServer
  def handle_info(:due, chip), do: {:noreply, chip |> Map.put(:timer, nil) |> happen() |> rearm()}

  def handle_info({:DOWN, monitor, :process, _pid, _reason}, chip) do
    case Enum.find(chip.handles, fn {_ref, handle} -> handle.owner == monitor end) do
      {ref, _handle} -> {:noreply, chip |> close(ref) |> rearm()}
      nil -> {:noreply, chip}
    end
  end

  defp reply(chip, answer), do: {:reply, answer, rearm(chip)}

  # Handles

  defp open(chip, spec, offsets, direction, opts, pid) do
    ref = make_ref()

    handle = %Handle{
      spec: spec,
      offsets: offsets,
      direction: direction,
      pull: opts[:pull_mode],
      drive: opts[:drive_mode],
      value: initial_value(opts[:initial_value]),
      owner: Process.monitor(pid)
    }

    chip |> configure(ref, handle) |> reply({:ok, ref})
  end

  defp initial_value(:not_set), do: 0
  defp initial_value(value), do: value

  defp close(chip, ref) do
    case Map.pop(chip.handles, ref) do
      {nil, _handles} ->
        chip

      {handle, handles} ->
        Process.demonitor(handle.owner, [:flush])
        let_go(%{chip | handles: handles}, handle.offsets)
    end
  end

  defp close_all(chip, offset) do
    for {ref, handle} <- chip.handles, offset in handle.offsets, reduce: chip do
      chip -> close(chip, ref)
    end
  end

  # A line that nobody has open is an input; its pull stays.
  defp let_go(chip, offsets) do
    now_ns = now_ns(chip)

    Enum.reduce(offsets, chip, fn offset, chip ->
      change(chip, offset, &Line.host(&1, :input, :not_set), now_ns, nil)
    end)
  end

  defp configure(chip, ref, handle) do
    now_ns = now_ns(chip)
    chip = put_in(chip.handles[ref], handle)

    Enum.reduce(handle.offsets, chip, fn offset, chip ->
      change(chip, offset, &Line.host(&1, Handle.host(handle, offset), handle.pull), now_ns, nil)
    end)
  end

  defp operate(:read, handle, _ref, chip), do: {:reply, {:ok, value(chip, handle)}, chip}

  defp operate({:write, _value}, %{direction: :input}, _ref, chip),
    do: {:reply, {:error, :pin_not_output}, chip}

  defp operate({:write, value}, handle, ref, chip),
    do: chip |> configure(ref, %{handle | value: value}) |> reply(:ok)

  defp operate({:listen, trigger, _tag, _receiver}, %{direction: :output}, _ref, chip)
       when trigger != :none,
       do: {:reply, {:error, :einval}, chip}

  defp operate({:listen, trigger, tag, receiver}, handle, ref, chip) do
    handle = %{handle | trigger: trigger, tag: tag, receiver: receiver}
    {:reply, :ok, put_in(chip.handles[ref], %{handle | shadow: value(chip, handle)})}
  end

  defp operate({:set, :direction, :output}, %{trigger: trigger}, _ref, chip)
       when trigger != :none,
       do: {:reply, {:error, :einval}, chip}

  defp operate({:set, key, value}, handle, ref, chip),
    do: chip |> configure(ref, Map.replace!(handle, key, value)) |> reply(:ok)

  defp value(chip, handle), do: Handle.value(handle, &line(chip, &1).near)

  defp identifiers(chip, offset) do
    %{
      location: {chip.name, offset},
      controller: chip.label,
      label: Map.get(chip.labels, offset, "")
    }
  end

  defp status(chip, offset) do
    line = line(chip, offset)
    handle = Enum.find_value(chip.handles, fn {_, h} -> if offset in h.offsets, do: h end)

    %{
      consumer: if(handle, do: "circuits_gpio", else: ""),
      direction: if(line.host == :input, do: :input, else: :output),
      pull_mode: asked_pull(handle),
      drive_mode: if(handle, do: handle.drive, else: :push_pull)
    }
  end

  # The kernel tells what it was asked for, not what the pin has from before.
  defp asked_pull(%{pull: pull}) when pull in [:pullup, :pulldown], do: pull
  defp asked_pull(_none), do: :none

  # Lines: what changes one, and who is told.

  defp line(chip, offset), do: Map.get(chip.lines, offset, %Line{})

  defp drive(chip, offset, driver, drive, time_ns),
    do: change(chip, offset, &Line.drive(&1, driver, drive), time_ns, driver)

  defp change(chip, offset, fun, time_ns, doer) do
    old = line(chip, offset)
    new = fun.(old)
    chip = put_in(chip.lines[offset], new)
    chip = if new.near == old.near, do: chip, else: edge(chip, offset, new.near, time_ns)
    if new.far == old.far, do: chip, else: felt(chip, offset, new.far, time_ns, doer)
  end

  defp edge(chip, offset, level, time_ns) do
    case Enum.find(chip.handles, fn {_ref, handle} -> offset in handle.offsets end) do
      nil ->
        chip

      {ref, handle} ->
        {message, handle} = Handle.edge(handle, offset, level, time_ns + chip.offset_ns)
        if message, do: send(handle.receiver, message)
        put_in(chip.handles[ref], handle)
    end
  end

  defp felt(chip, offset, level, time_ns, doer) do
    for {name, part} <- chip.parts,
        doer != {:device, name},
        pin = Part.pin(part, offset),
        reduce: chip do
      chip -> part |> Part.level(pin, level, time_ns) |> act(name, chip, time_ns)
    end
  end

  # Devices

  defp plug(name, device, chip) do
    now_ns = now_ns(chip)

    with {:ok, part, effects} <- Part.new(device, now_ns, chip.count),
         do: {:ok, act({part, effects}, name, chip, now_ns)}
  end

  defp plugged({:ok, chip}, _before), do: reply(chip, :ok)
  defp plugged({:raise, exception}, chip), do: {:reply, {:raise, exception}, chip}

  defp plug_all([], chip), do: {:ok, rearm(chip)}

  defp plug_all([{name, device} | rest], chip) do
    case plug(name, device, chip) do
      {:ok, chip} -> plug_all(rest, chip)
      {:raise, exception} -> {:stop, exception}
    end
  end

  defp present(%{plugged?: true} = part), do: {part.module, part.opts}
  defp present(_nothing), do: nil

  defp wire({:ok, chip}, name, robot, _before), do: chip |> wired(name, robot) |> reply(:ok)
  defp wire({:raise, exception}, _name, _robot, chip), do: {:reply, {:raise, exception}, chip}

  defp wired(chip, name, robot), do: %{chip | wired: Wired.add(chip.wired, name, robot)}

  defp pull(chip, name), do: put_in(chip.parts[name].plugged?, false) |> disconnect(name)

  defp obey(:unplug, name, _part, chip), do: chip |> pull(name) |> reply(:ok)

  defp obey(:replug, _name, %{plugged?: true, broken?: false}, chip), do: {:reply, :ok, chip}

  defp obey(:replug, name, part, chip),
    do: plugged(plug(name, {part.module, part.opts}, chip), chip)

  defp disconnect(chip, name) do
    now_ns = now_ns(chip)
    chip = %{chip | agenda: Agenda.drop(chip.agenda, {:device, name})}

    for {_pin, offset} <- chip.parts[name].pins, reduce: chip do
      chip -> drive(chip, offset, {:device, name}, :z, now_ns)
    end
  end

  defp told(name, part, order, chip) do
    now_ns = now_ns(chip)

    case Part.order(part, order, now_ns) do
      :error -> {:reply, {:error, :unknown_order}, chip}
      acted -> acted |> act(name, chip, now_ns) |> reply(:ok)
    end
  end

  defp act({part, effects}, name, chip, now_ns) do
    chip = put_in(chip.parts[name], part)
    Enum.reduce(effects, chip, &effect(&1, {:device, name}, &2, now_ns))
  end

  defp effect({:drive, offset, drive}, doer, chip, now_ns),
    do: drive(chip, offset, doer, drive, now_ns)

  defp effect({:drive, offset, drive, time_ns}, doer, chip, _now_ns),
    do: %{chip | agenda: Agenda.put(chip.agenda, time_ns, doer, {:drive, offset, drive})}

  defp effect({:at, time_ns, event}, doer, chip, _now_ns),
    do: %{chip | agenda: Agenda.put(chip.agenda, time_ns, doer, {:event, event})}

  defp effect(:cancel, doer, chip, _now_ns),
    do: %{chip | agenda: Agenda.drop(chip.agenda, doer)}

  defp effect(:break, {:device, name}, chip, _now_ns), do: disconnect(chip, name)

  defp describe(part), do: Map.take(part, [:module, :pins, :plugged?, :broken?])

  # Time: what was put for later happens in its order, each at its own time.

  defp happen(chip), do: happen(chip, now_ns(chip))

  defp happen(chip, now_ns) do
    case Agenda.take(chip.agenda, now_ns) do
      {time_ns, owner, what, agenda} ->
        owner |> come(what, %{chip | agenda: agenda}, time_ns) |> happen(now_ns)

      :none ->
        chip
    end
  end

  defp come({:driver, offset, driver}, drive, chip, time_ns),
    do: drive(chip, offset, driver, drive, time_ns)

  defp come({:device, _name} = doer, {:drive, offset, drive}, chip, time_ns),
    do: drive(chip, offset, doer, drive, time_ns)

  defp come({:device, name}, {:event, event}, chip, time_ns),
    do: chip.parts[name] |> Part.due(event, time_ns) |> act(name, chip, time_ns)

  defp come({:storm, offset}, hz, chip, time_ns) do
    chip
    |> change(offset, &Line.disturb/1, time_ns, nil)
    |> storm(offset, {:storm, hz}, time_ns)
  end

  defp storm(chip, offset, {:storm, hz}, time_ns) do
    next_ns = time_ns + div(1_000_000_000, hz)
    %{chip | agenda: Agenda.put(chip.agenda, next_ns, {:storm, offset}, hz)}
  end

  defp storm(chip, _offset, _fault, _time_ns), do: chip

  defp rearm(%{timer: timer} = chip) do
    case {Agenda.next_ns(chip.agenda), timer} do
      {same, {same, _ref}} -> chip
      {nil, nil} -> chip
      {next_ns, timer} -> %{chip | timer: arm(chip.clock, next_ns, timer)}
    end
  end

  defp arm(clock, next_ns, {_time_ns, ref}) do
    Clock.cancel(clock, ref)
    arm(clock, next_ns, nil)
  end

  defp arm(_clock, nil, nil), do: nil

  defp arm(clock, next_ns, nil),
    do: {next_ns, Clock.send_at(clock, next_ns, self(), :due)}

  defp now_ns(chip), do: Clock.now_ns(chip.clock)

  defp check_options!(opts) do
    case Keyword.keys(opts) -- @options do
      [] -> :ok
      unknown -> raise ArgumentError, "unknown options of a chip: #{inspect(unknown)}"
    end
  end
end
