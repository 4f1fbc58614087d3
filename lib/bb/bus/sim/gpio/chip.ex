defmodule BB.Bus.Sim.GPIO.Chip do
  @moduledoc """
  One simulated chip of lines: its lines, the devices on them, and the events to come.

  `BB.Bus.Sim.GPIO.Server` keeps one and passes the time. It is pure, except that it sends the
  messages of edges, and logs a model that raises.

      iex> alias BB.Bus.Sim.GPIO.Chip
      iex> bumper = {BB.Bus.Sim.Contact, pins: [contact: 17]}
      iex> {:ok, chip} = "gpiochip7" |> Chip.new([]) |> Chip.plug(:bumper, bumper, 0)
      iex> {:ok, chip} = Chip.order(chip, :bumper, :press, 10)
      iex> Chip.describe(chip, 17)
      %{near: 0, far: 0, fault: nil, open?: false}

  A change of a line (`change/5`) reaches the handle that is open on it as an edge, and the
  devices whose pins are wired to it. Their effects are applied at once or go into the agenda.
  """

  alias BB.Bus.Sim.GPIO.{Agenda, Handle, Line, Part}

  @enforce_keys [:name, :count, :label, :labels, :offset_ns, :agenda]
  defstruct [
    :name,
    :count,
    :label,
    :labels,
    :offset_ns,
    :agenda,
    lines: %{},
    handles: %{},
    parts: %{}
  ]

  @typedoc "A chip. `offset_ns` is added to its time for the timestamps of edges."
  @type t :: %__MODULE__{}

  @typedoc "The number of a line."
  @type offset :: non_neg_integer()

  @doc "Returns a chip without devices, from the options of `BB.Bus.Sim.Lines.start_link/1`."
  @spec new(String.t(), keyword()) :: t()
  def new(name, opts) do
    %__MODULE__{
      name: name,
      count: opts[:lines] || 54,
      label: opts[:label] || name,
      labels: Map.new(opts[:labels] || %{}),
      offset_ns: opts[:timestamp_offset_ns] || 0,
      agenda: Agenda.new()
    }
  end

  @doc "Returns the names of all lines, in their order."
  @spec identifiers(t()) :: [BB.Bus.Sim.GPIO.identifiers()]
  def identifiers(chip) do
    for offset <- 0..(chip.count - 1) do
      %{
        location: {chip.name, offset},
        controller: chip.label,
        label: Map.get(chip.labels, offset, "")
      }
    end
  end

  @doc "Returns the levels of a line, its fault, and whether a handle is open on it."
  @spec describe(t(), offset()) :: map()
  def describe(chip, offset) do
    line = line(chip, offset)
    open? = handle_on(chip, offset) != nil
    %{near: line.near, far: line.far, fault: line.fault, open?: open?}
  end

  @doc "Returns a line."
  @spec line(t(), offset()) :: Line.t()
  def line(chip, offset), do: Map.get(chip.lines, offset, %Line{})

  @doc "Returns the handle that is open on a line, with its ref, or `nil`."
  @spec handle_on(t(), offset()) :: {reference(), Handle.t()} | nil
  def handle_on(chip, offset),
    do: Enum.find(chip.handles, fn {_ref, handle} -> offset in handle.offsets end)

  @doc """
  Changes a line at a time, by a function, and passes a new level on to its handle and its
  devices.

  A device does not get the changes that it makes: `{:device, name}` is its `driver`.
  """
  @spec change(t(), offset(), (Line.t() -> Line.t()), integer(), driver :: term()) :: t()
  def change(chip, offset, fun, time_ns, driver \\ nil) do
    old = line(chip, offset)
    new = fun.(old)
    chip = put_in(chip.lines[offset], new)
    chip = if new.near == old.near, do: chip, else: send_edge(chip, offset, new.near, time_ns)
    if new.far == old.far, do: chip, else: pass_level(chip, offset, new.far, time_ns, driver)
  end

  defp send_edge(chip, offset, level, time_ns) do
    case handle_on(chip, offset) do
      nil ->
        chip

      {ref, handle} ->
        {message, handle} = Handle.edge(handle, offset, level, time_ns + chip.offset_ns)
        if message, do: send(handle.receiver, message)
        put_in(chip.handles[ref], handle)
    end
  end

  defp pass_level(chip, offset, level, time_ns, driver) do
    for {name, part} <- chip.parts,
        driver != {:device, name},
        pin = Part.pin(part, offset),
        reduce: chip do
      chip -> part |> Part.level(pin, level, time_ns) |> put_part(name, chip, time_ns)
    end
  end

  @doc "Drives a line from its far end."
  @spec drive(t(), offset(), driver :: term(), Line.drive(), integer()) :: t()
  def drive(chip, offset, driver, drive, time_ns),
    do: change(chip, offset, &Line.drive(&1, driver, drive), time_ns, driver)

  @doc "Puts a drive of a line into the agenda."
  @spec schedule_drive(t(), offset(), driver :: term(), Line.drive(), integer()) :: t()
  def schedule_drive(chip, offset, driver, drive, time_ns),
    do: schedule(chip, time_ns, {:driver, offset, driver}, drive)

  @doc "Lets a line go, and removes what its driver has scheduled."
  @spec release(t(), offset(), driver :: term(), integer()) :: t()
  def release(chip, offset, driver, now_ns),
    do: chip |> unschedule({:driver, offset, driver}) |> drive(offset, driver, :z, now_ns)

  @doc "Sets the fault of a line, or clears it with `nil`."
  @spec put_fault(t(), offset(), Line.fault() | nil, integer()) :: t()
  def put_fault(chip, offset, fault, now_ns) do
    chip
    |> unschedule({:storm, offset})
    |> change(offset, &Line.fault(&1, fault), now_ns)
    |> schedule_noise(offset, fault, now_ns)
  end

  # Devices

  @doc "Returns the model and the options of a device that is plugged in, or `nil`."
  @spec present(t(), name :: atom()) :: {module(), keyword()} | nil
  def present(chip, name) do
    case chip.parts do
      %{^name => %{plugged?: true} = part} -> {part.module, part.opts}
      _absent -> nil
    end
  end

  @doc "Plugs a device in, powered up."
  @spec plug(t(), name :: atom(), {module(), keyword()}, integer()) ::
          {:ok, t()} | {:raise, Exception.t()}
  def plug(chip, name, device, now_ns) do
    with {:ok, part, effects} <- Part.new(device, now_ns, chip.count),
         do: {:ok, put_part({part, effects}, name, chip, now_ns)}
  end

  @doc "Disconnects a device from its lines."
  @spec unplug(t(), name :: atom(), integer()) :: {:ok, t()} | {:error, :no_device}
  def unplug(chip, name, now_ns) do
    with {:ok, _part} <- fetch_part(chip, name),
         do: {:ok, put_in(chip.parts[name].plugged?, false) |> disconnect(name, now_ns)}
  end

  @doc "Plugs the same device in again, powered up. A device that works is left as it is."
  @spec replug(t(), name :: atom(), integer()) ::
          {:ok, t()} | {:error, :no_device} | {:raise, Exception.t()}
  def replug(chip, name, now_ns) do
    case fetch_part(chip, name) do
      {:ok, %{plugged?: true, broken?: false}} -> {:ok, chip}
      {:ok, part} -> plug(chip, name, {part.module, part.opts}, now_ns)
      error -> error
    end
  end

  @doc "Gives a device an order, such as `:press`."
  @spec order(t(), name :: atom(), order :: term(), integer()) ::
          {:ok, t()} | {:error, :no_device | :unknown_order}
  def order(chip, name, order, now_ns) do
    case fetch_part(chip, name) do
      {:ok, %{plugged?: true, broken?: false} = part} ->
        case Part.order(part, order, now_ns) do
          :error -> {:error, :unknown_order}
          result -> {:ok, put_part(result, name, chip, now_ns)}
        end

      _none ->
        {:error, :no_device}
    end
  end

  @doc "Returns all devices that were ever plugged in, by name."
  @spec devices(t()) :: %{atom() => map()}
  def devices(chip) do
    Map.new(chip.parts, fn {name, part} ->
      {name, Map.take(part, [:module, :pins, :plugged?, :broken?])}
    end)
  end

  defp fetch_part(chip, name) do
    with :error <- Map.fetch(chip.parts, name), do: {:error, :no_device}
  end

  defp disconnect(chip, name, now_ns) do
    chip = unschedule(chip, {:device, name})

    for {_pin, offset} <- chip.parts[name].pins, reduce: chip do
      chip -> drive(chip, offset, {:device, name}, :z, now_ns)
    end
  end

  defp put_part({part, effects}, name, chip, now_ns) do
    chip = put_in(chip.parts[name], part)
    Enum.reduce(effects, chip, &apply_effect(&1, {:device, name}, &2, now_ns))
  end

  defp apply_effect({:drive, offset, drive}, driver, chip, now_ns),
    do: drive(chip, offset, driver, drive, now_ns)

  defp apply_effect({:drive, offset, drive, time_ns}, driver, chip, _now_ns),
    do: schedule(chip, time_ns, driver, {:drive, offset, drive})

  defp apply_effect({:at, time_ns, event}, driver, chip, _now_ns),
    do: schedule(chip, time_ns, driver, {:event, event})

  defp apply_effect(:cancel, driver, chip, _now_ns), do: unschedule(chip, driver)

  defp apply_effect(:break, {:device, name}, chip, now_ns), do: disconnect(chip, name, now_ns)

  # Time

  @doc "Returns the time of the next event in the agenda, or `nil`."
  @spec next_ns(t()) :: integer() | nil
  def next_ns(chip), do: Agenda.next_ns(chip.agenda)

  @doc "Runs the events up to `now_ns`, in their order and each at its own time."
  @spec advance(t(), integer()) :: t()
  def advance(chip, now_ns) do
    case Agenda.take(chip.agenda, now_ns) do
      {time_ns, owner, event, agenda} ->
        owner |> run_event(event, %{chip | agenda: agenda}, time_ns) |> advance(now_ns)

      :none ->
        chip
    end
  end

  defp run_event({:driver, offset, driver}, drive, chip, time_ns),
    do: drive(chip, offset, driver, drive, time_ns)

  defp run_event({:device, _name} = driver, {:drive, offset, drive}, chip, time_ns),
    do: drive(chip, offset, driver, drive, time_ns)

  defp run_event({:device, name}, {:event, event}, chip, time_ns),
    do: chip.parts[name] |> Part.due(event, time_ns) |> put_part(name, chip, time_ns)

  defp run_event({:storm, offset}, hz, chip, time_ns) do
    chip
    |> change(offset, &Line.disturb/1, time_ns)
    |> schedule_noise(offset, {:storm, hz}, time_ns)
  end

  defp schedule_noise(chip, offset, {:storm, hz}, time_ns),
    do: schedule(chip, time_ns + div(1_000_000_000, hz), {:storm, offset}, hz)

  defp schedule_noise(chip, _offset, _fault, _time_ns), do: chip

  defp schedule(chip, time_ns, owner, event),
    do: %{chip | agenda: Agenda.put(chip.agenda, time_ns, owner, event)}

  defp unschedule(chip, owner), do: %{chip | agenda: Agenda.drop(chip.agenda, owner)}
end
