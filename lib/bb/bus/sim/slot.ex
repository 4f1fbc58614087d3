defmodule BB.Bus.Sim.Slot do
  @moduledoc """
  One address of a simulated bus: the device's model, its state and its fault.

  `BB.Bus.Sim.Server` keeps one for each address. A slot stays when its device is unplugged. It is
  pure, except that it logs a model that raises.
  """
  @moduledoc no_example: "internal: BB.Bus.Sim is its interface"

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

  @typedoc "A slot, with the state of a second device (`:twin`) and the random state (`:dice`)."
  @type t :: %__MODULE__{}

  @typedoc "The bytes that a transfer writes, or `nil`, and how many it reads, or `nil`."
  @type request :: {binary() | nil, non_neg_integer() | nil}

  @typedoc "The result of a transfer."
  @type answer :: :ok | {:ok, binary()} | {:error, term()}

  @doc "Powers a device up. Returns `{:raise, exception}` when its model refuses its options."
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
    kind, reason -> {:raise, BB.Bus.Sim.Device.init_error(module, kind, reason)}
  end

  @doc "Powers an unplugged device up again."
  @spec replug(t(), integer()) :: {:ok, t()} | {:error, term()}
  def replug(%__MODULE__{plugged?: true, broken?: false} = slot, _now_ns), do: {:ok, slot}

  def replug(slot, now_ns) do
    case new({slot.module, slot.opts}, now_ns) do
      {:ok, fresh} -> {:ok, %{fresh | transfers: slot.transfers}}
      {:raise, exception} -> {:error, exception}
      {:error, reason} -> {:error, reason}
    end
  end

  @doc "Disconnects the device, and clears its fault."
  @spec unplug(t()) :: t()
  def unplug(slot), do: %{clear_fault(slot) | plugged?: false}

  @doc """
  Sets the device's fault.

  Returns `{:raise, exception}` or `{:error, reason}` when a twin cannot be powered up.
  """
  @spec put_fault(t(), Fault.t(), integer()) ::
          {:ok, t()} | {:error, term()} | {:raise, Exception.t()}
  def put_fault(slot, {:twin, device} = fault, now_ns) do
    with {:ok, twin} <- new(device, now_ns),
         do: {:ok, %{clear_fault(slot) | fault: fault, twin: twin}}
  end

  def put_fault(slot, fault, _now_ns),
    do: {:ok, %{clear_fault(slot) | fault: fault, dice: Fault.dice(fault)}}

  @doc "Clears the device's fault."
  @spec clear_fault(t()) :: t()
  def clear_fault(slot), do: %{slot | fault: nil, twin: nil, dice: nil}

  @doc """
  Makes one attempt of a transfer.

  Returns the answer, for how many milliseconds the device holds the bus beyond the time of the
  bytes, and the slot. The slot is `nil` at an address that never had a device.
  """
  @spec attempt(t() | nil, request(), timeout_ms :: pos_integer(), integer()) ::
          {answer(), held_ms :: non_neg_integer(), t() | nil}
  def attempt(nil, _request, _timeout_ms, _now_ns), do: {{:error, :i2c_nak}, 0, nil}

  def attempt(%{plugged?: false} = slot, _request, _timeout_ms, _now_ns),
    do: {{:error, :i2c_nak}, 0, slot}

  def attempt(slot, request, timeout_ms, now_ns) do
    {kind, fault} = Fault.next(slot.fault)
    attempt_with(kind, %{slot | fault: fault}, request, timeout_ms, now_ns)
  end

  @doc """
  Returns the pulses of the device's interrupt pin (`c:BB.Bus.Sim.Device.pulses/3`), or `nil` when
  its model makes none.
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

  # With the fault of this attempt, nil for none.

  defp attempt_with(nil, slot, request, _timeout_ms, now_ns) do
    {answer, slot} = call_model(slot, request, now_ns)
    {answer, 0, slot}
  end

  defp attempt_with({:slow, ms}, slot, request, timeout_ms, now_ns) when ms < timeout_ms do
    {answer, slot} = call_model(slot, request, now_ns)
    {answer, ms, slot}
  end

  defp attempt_with(kind, slot, _request, timeout_ms, _now_ns)
       when kind == :timeout or elem(kind, 0) == :slow,
       do: {{:error, :timeout}, timeout_ms, slot}

  defp attempt_with({:twin, _device}, slot, request, _timeout_ms, now_ns) do
    {one, slot} = call_model(slot, request, now_ns)
    {other, twin} = call_model(slot.twin, request, now_ns)
    {wired_and(one, other), 0, %{slot | twin: twin}}
  end

  defp attempt_with({:bit_errors, probability, _seed}, slot, request, timeout_ms, now_ns),
    do: attempt_with({:bit_errors, probability}, slot, request, timeout_ms, now_ns)

  defp attempt_with({:bit_errors, probability}, slot, {data, count}, _timeout_ms, now_ns) do
    {data, dice} = corrupt(data, probability, slot.dice)
    {answer, slot} = call_model(slot, {data, count}, now_ns)
    {answer, dice} = corrupt(answer, probability, dice)
    {answer, 0, %{slot | dice: dice}}
  end

  defp attempt_with(failure, slot, _request, _timeout_ms, _now_ns),
    do: {{:error, Fault.error(failure)}, 0, slot}

  # Either device can pull the line low: an acknowledgement is low, and so is a 0.
  defp wired_and({:error, _}, other), do: other
  defp wired_and(one, {:error, _}), do: one
  defp wired_and({:ok, one}, {:ok, other}), do: {:ok, bitwise_and(one, other)}
  defp wired_and(:ok, :ok), do: :ok

  defp bitwise_and(one, other) do
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

  defp call_model(%{broken?: true} = slot, _request, _now_ns), do: {{:error, :i2c_nak}, slot}

  defp call_model(slot, request, now_ns) do
    case exchange(slot, request, now_ns) do
      {:nak, state} -> {{:error, :i2c_nak}, %{slot | state: state}}
      {answer, state} -> {answer, %{slot | state: state, transfers: slot.transfers + 1}}
    end
  catch
    kind, reason -> mark_broken(slot, kind, reason, __STACKTRACE__)
  end

  defp exchange(slot, {data, nil}, now_ns), do: write(slot, data, now_ns)

  defp exchange(slot, {data, count}, now_ns) do
    with {:ok, state} <- write(slot, data, now_ns), do: read(slot.module, count, now_ns, state)
  end

  # A transfer without bytes is only the address, which the device acknowledges.
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

  defp mark_broken(slot, kind, reason, stacktrace) do
    Logger.error(
      "simulated device #{inspect(slot.module)} is broken until it is plugged in again: " <>
        Exception.format(kind, reason, stacktrace)
    )

    {{:error, :i2c_nak}, %{slot | broken?: true}}
  end
end
