defmodule BB.Bus.Sim.GPIO.Handles do
  @moduledoc """
  Opens, uses and closes the handles of a simulated chip's lines.

  `BB.Bus.Sim.GPIO.Server` calls it, in whose process it monitors the owners of handles.
  `BB.Bus.Sim.GPIO.Handle` is one handle.
  """
  @moduledoc no_example: "internal: BB.Bus.Sim.GPIO is its interface"

  alias BB.Bus.Sim.GPIO.{Chip, Handle, Line}

  @doc """
  Opens lines for the process `pid`, with the checked options of `BB.Bus.Sim.GPIO.open/3`.

  With `on_busy: :take_over` it closes the other handles of the lines.
  """
  @spec open(Chip.t(), term(), [Chip.offset()], :input | :output, keyword(), pid(), integer()) ::
          {:ok, reference(), Chip.t()} | {:error, :einval | :already_open}
  def open(chip, spec, offsets, direction, opts, pid, now_ns) do
    others = for {ref, handle} <- chip.handles, overlap?(handle.offsets, offsets), do: ref

    cond do
      Enum.any?(offsets, &(&1 not in 0..(chip.count - 1))) ->
        {:error, :einval}

      Enum.any?(offsets, &(Chip.line(chip, &1).fault == :busy)) ->
        {:error, :already_open}

      others != [] and opts[:on_busy] != :take_over ->
        {:error, :already_open}

      true ->
        ref = make_ref()
        chip = Enum.reduce(others, chip, &close(&2, &1, now_ns))
        {:ok, ref, put(chip, ref, new(spec, offsets, direction, opts, pid), now_ns)}
    end
  end

  defp overlap?(some, others), do: some -- others != some

  defp new(spec, offsets, direction, opts, pid) do
    %Handle{
      spec: spec,
      offsets: offsets,
      direction: direction,
      pull: opts[:pull_mode],
      drive: opts[:drive_mode],
      value: opts[:initial_value],
      owner: Process.monitor(pid)
    }
  end

  @doc "Closes a handle. Its lines become inputs and keep their pulls."
  @spec close(Chip.t(), reference(), integer()) :: Chip.t()
  def close(chip, ref, now_ns) do
    case Map.pop(chip.handles, ref) do
      {nil, _handles} ->
        chip

      {handle, handles} ->
        Process.demonitor(handle.owner, [:flush])

        for offset <- handle.offsets, reduce: %{chip | handles: handles} do
          chip -> Chip.change(chip, offset, &Line.host(&1, :input, :not_set), now_ns)
        end
    end
  end

  @doc "Closes all handles of a line."
  @spec close_all(Chip.t(), Chip.offset(), integer()) :: Chip.t()
  def close_all(chip, offset, now_ns) do
    for {ref, handle} <- chip.handles, offset in handle.offsets, reduce: chip do
      chip -> close(chip, ref, now_ns)
    end
  end

  @doc "Closes the handle whose owner has ended."
  @spec owner_down(Chip.t(), monitor :: reference(), integer()) :: Chip.t()
  def owner_down(chip, monitor, now_ns) do
    case Enum.find(chip.handles, fn {_ref, handle} -> handle.owner == monitor end) do
      {ref, _handle} -> close(chip, ref, now_ns)
      nil -> chip
    end
  end

  @doc "Runs a request of a handle: to read, write, change settings or get edges."
  @spec call(Chip.t(), reference(), request :: term(), integer()) :: {reply :: term(), Chip.t()}
  def call(chip, ref, request, now_ns) do
    case chip.handles do
      %{^ref => handle} -> operate(request, handle, ref, chip, now_ns)
      _closed -> {{:error, :ebadf}, chip}
    end
  end

  defp operate(:read, handle, _ref, chip, _now_ns), do: {{:ok, value(chip, handle)}, chip}

  defp operate({:write, _value}, %{direction: :input}, _ref, chip, _now_ns),
    do: {{:error, :pin_not_output}, chip}

  defp operate({:write, value}, handle, ref, chip, now_ns),
    do: {:ok, put(chip, ref, %{handle | value: value}, now_ns)}

  defp operate({:listen, trigger, _tag, _receiver}, %{direction: :output}, _ref, chip, _now_ns)
       when trigger != :none,
       do: {{:error, :einval}, chip}

  defp operate({:listen, trigger, tag, receiver}, handle, ref, chip, _now_ns) do
    handle = %{handle | trigger: trigger, tag: tag, receiver: receiver}
    {:ok, put_in(chip.handles[ref], %{handle | shadow: value(chip, handle)})}
  end

  defp operate({:set, :direction, :output}, %{trigger: trigger}, _ref, chip, _now_ns)
       when trigger != :none,
       do: {{:error, :einval}, chip}

  defp operate({:set, key, value}, handle, ref, chip, now_ns),
    do: {:ok, put(chip, ref, Map.replace!(handle, key, value), now_ns)}

  @doc "Returns the settings of a line, as the kernel reports them."
  @spec status(Chip.t(), Chip.offset()) :: {:ok, map()} | {:error, :einval}
  def status(chip, offset) when offset < chip.count do
    handle = with {_ref, handle} <- Chip.handle_on(chip, offset), do: handle

    {:ok,
     %{
       consumer: if(handle, do: "circuits_gpio", else: ""),
       direction: if(Chip.line(chip, offset).host == :input, do: :input, else: :output),
       pull_mode: reported_pull(handle),
       drive_mode: if(handle, do: handle.drive, else: :push_pull)
     }}
  end

  def status(_chip, _offset), do: {:error, :einval}

  # The kernel reports the pull of the handle, not the one that the pin kept from before.
  defp reported_pull(%{pull: pull}) when pull in [:pullup, :pulldown], do: pull
  defp reported_pull(_none), do: :none

  # Stores a handle, and sets its pins.
  defp put(chip, ref, handle, now_ns) do
    for offset <- handle.offsets, reduce: put_in(chip.handles[ref], handle) do
      chip ->
        host = Handle.host(handle, offset)
        Chip.change(chip, offset, &Line.host(&1, host, handle.pull), now_ns)
    end
  end

  defp value(chip, handle), do: Handle.value(handle, &Chip.line(chip, &1).near)
end
