defmodule BB.Bus.Sim.Slot do
  @moduledoc """
  One address of a simulated bus: the device's model with its state, and what is wrong with it.

  Pure but for the log entry of a model that raised. A slot outlives its device's wires: it stays when the device is unplugged.
  """
  require Logger

  alias BB.Bus.Sim.Fault

  @enforce_keys [:module, :opts, :state]
  defstruct [
    :module,
    :opts,
    :state,
    :twin,
    :dice,
    fault: nil,
    plugged?: true,
    broken?: false,
    transfers: 0
  ]

  @type t :: %__MODULE__{}

  @typedoc "What a transfer asks for: bytes to write (or `nil`) and a count to read (or `nil`)."
  @type request :: {binary() | nil, non_neg_integer() | nil}

  @type answer :: :ok | {:ok, binary()} | {:error, term()}

  @doc "A device at power-on. `{:raise, exception}` when its model refuses its options."
  @spec new(BB.Bus.Sim.device(), integer()) ::
          {:ok, t()} | {:error, term()} | {:raise, Exception.t()}
  def new({module, opts}, now_ns) do
    case module.init(opts, now_ns) do
      {:ok, state} -> {:ok, %__MODULE__{module: module, opts: opts, state: state}}
      {:error, reason} -> {:error, reason}
    end
  rescue
    exception -> {:raise, exception}
  catch
    kind, reason -> {:raise, BB.Bus.Sim.Device.not_made(module, kind, reason)}
  end

  @doc "Powers an unplugged device up anew."
  @spec replug(t(), integer()) :: {:ok, t()} | {:error, term()}
  def replug(%__MODULE__{plugged?: true, broken?: false} = slot, _now_ns), do: {:ok, slot}

  def replug(slot, now_ns) do
    case new({slot.module, slot.opts}, now_ns) do
      {:ok, fresh} -> {:ok, %{fresh | transfers: slot.transfers}}
      {:raise, exception} -> {:error, exception}
      {:error, reason} -> {:error, reason}
    end
  end

  @doc "Pulls the wires: what was wrong with the device goes with them."
  @spec unplug(t()) :: t()
  def unplug(slot), do: %{mend(slot) | plugged?: false}

  @doc "Makes the device fail. `{:raise, exception}` or `{:error, reason}` when a twin cannot be made."
  @spec harm(t(), Fault.t(), integer()) :: {:ok, t()} | {:error, term()} | {:raise, Exception.t()}
  def harm(slot, {:twin, device} = fault, now_ns) do
    with {:ok, twin} <- new(device, now_ns), do: {:ok, %{mend(slot) | fault: fault, twin: twin}}
  end

  def harm(slot, fault, _now_ns),
    do: {:ok, %{mend(slot) | fault: fault, dice: Fault.dice(fault)}}

  @doc "Ends what is wrong with the device."
  @spec mend(t()) :: t()
  def mend(slot), do: %{slot | fault: nil, twin: nil, dice: nil}

  @doc """
  One attempt of a transfer: its answer, how long the device holds the bus beyond the bytes, in milliseconds, and the slot after it.
  `nil` is an address where nothing ever was.
  """
  @spec attempt(t() | nil, request(), timeout_ms :: pos_integer(), integer()) ::
          {answer(), held_ms :: non_neg_integer(), t() | nil}
  def attempt(nil, _request, _timeout_ms, _now_ns), do: {{:error, :i2c_nak}, 0, nil}

  def attempt(%{plugged?: false} = slot, _request, _timeout_ms, _now_ns),
    do: {{:error, :i2c_nak}, 0, slot}

  def attempt(slot, request, timeout_ms, now_ns) do
    {wrong, fault} = Fault.meet(slot.fault)
    suffer(wrong, %{slot | fault: fault}, request, timeout_ms, now_ns)
  end

  @doc """
  The pulses of the device's interrupt pin, see `c:BB.Bus.Sim.Device.pulses/3`; none when its
  model cannot say.
  """
  @spec pulses(t(), integer(), integer()) :: map() | nil
  def pulses(%{plugged?: true, broken?: false} = slot, from_ns, to_ns) do
    if function_exported?(slot.module, :pulses, 3) do
      with %{line: _, times_ns: _, width_ns: _, next_ns: _} = pulses <-
             slot.module.pulses(from_ns, to_ns, slot.state),
           do: pulses,
           else: (_other -> nil)
    end
  catch
    _kind, _reason -> nil
  end

  def pulses(_slot, _from_ns, _to_ns), do: nil

  defp suffer({:slow, ms}, slot, request, timeout_ms, now_ns) when ms < timeout_ms do
    {answer, slot} = perform(slot, request, now_ns)
    {answer, ms, slot}
  end

  defp suffer(wrong, slot, _request, timeout_ms, _now_ns)
       when wrong == :timeout or elem(wrong, 0) == :slow,
       do: {{:error, :timeout}, timeout_ms, slot}

  defp suffer({:twin, _device}, slot, request, _timeout_ms, now_ns) do
    {one, slot} = perform(slot, request, now_ns)
    {other, twin} = perform(slot.twin, request, now_ns)
    {wired_and(one, other), 0, %{slot | twin: twin}}
  end

  defp suffer({:bit_errors, probability, _seed}, slot, request, timeout_ms, now_ns),
    do: suffer({:bit_errors, probability}, slot, request, timeout_ms, now_ns)

  defp suffer({:bit_errors, probability}, slot, {data, count}, _timeout_ms, now_ns) do
    {data, dice} = corrupt(data, probability, slot.dice)
    {answer, slot} = perform(slot, {data, count}, now_ns)
    {answer, dice} = corrupt(answer, probability, dice)
    {answer, 0, %{slot | dice: dice}}
  end

  defp suffer(nil, slot, request, _timeout_ms, now_ns) do
    {answer, slot} = perform(slot, request, now_ns)
    {answer, 0, slot}
  end

  defp suffer(failure, slot, _request, _timeout_ms, _now_ns),
    do: {{:error, Fault.error(failure)}, 0, slot}

  # Both drive one line that either can pull low: an acknowledgement is low, and so is a 0.
  defp wired_and({:error, _}, other), do: other
  defp wired_and(one, {:error, _}), do: one
  defp wired_and({:ok, one}, {:ok, other}), do: {:ok, both(one, other)}
  defp wired_and(:ok, :ok), do: :ok

  defp both(one, other) do
    size = byte_size(one)
    both = Bitwise.band(:binary.decode_unsigned(one), :binary.decode_unsigned(other))
    <<both::size(size)-unit(8)>>
  end

  defp corrupt({:ok, bytes}, probability, dice) do
    {bytes, dice} = Fault.corrupt(bytes, probability, dice)
    {{:ok, bytes}, dice}
  end

  defp corrupt(bytes, probability, dice) when is_binary(bytes),
    do: Fault.corrupt(bytes, probability, dice)

  defp corrupt(without_bytes, _probability, dice), do: {without_bytes, dice}

  defp perform(%{broken?: true} = slot, _request, _now_ns), do: {{:error, :i2c_nak}, slot}

  defp perform(slot, request, now_ns) do
    case exchange(slot, request, now_ns) do
      {:nak, state} -> {{:error, :i2c_nak}, %{slot | state: state}}
      {answer, state} -> {answer, %{slot | state: state, transfers: slot.transfers + 1}}
    end
  catch
    kind, reason -> broke(slot, kind, reason, __STACKTRACE__)
  end

  defp exchange(slot, {data, nil}, now_ns), do: write(slot, data, now_ns)

  defp exchange(slot, {data, count}, now_ns) do
    with {:ok, state} <- write(slot, data, now_ns), do: read(slot.module, count, now_ns, state)
  end

  # Without bytes a transfer is its address alone, which the device acknowledges without more.
  defp write(slot, data, _now_ns) when data in [nil, <<>>], do: {:ok, slot.state}

  defp write(slot, data, now_ns) do
    case slot.module.write(data, now_ns, slot.state) do
      {:ok, state} -> {:ok, state}
      {:nak, state} -> {:nak, state}
    end
  end

  defp read(_module, 0, _now_ns, state), do: {{:ok, <<>>}, state}

  defp read(module, count, now_ns, state) do
    case module.read(count, now_ns, state) do
      {:ok, bytes, state} when is_binary(bytes) and byte_size(bytes) == count ->
        {{:ok, bytes}, state}

      {:nak, state} ->
        {:nak, state}
    end
  end

  defp broke(slot, kind, reason, stacktrace) do
    Logger.error(
      "the simulated device #{inspect(slot.module)} is broken until it is plugged in again: " <>
        Exception.format(kind, reason, stacktrace)
    )

    {{:error, :i2c_nak}, %{slot | broken?: true}}
  end
end
