defmodule BB.Bus.Sim.Place do
  @moduledoc """
  One address of a simulated bus: the device's model, its state and its fault.

  `BB.Bus.Sim.Server` keeps one for each address. A place stays when its device is unplugged. The
  module is pure, except that it logs a model that raises.
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

  @typedoc "A place, with the state of a second device (`:twin`) and the random state (`:dice`)."
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
  def replug(%__MODULE__{plugged?: true, broken?: false} = place, _now_ns), do: {:ok, place}

  def replug(place, now_ns) do
    case new({place.module, place.opts}, now_ns) do
      {:ok, fresh} -> {:ok, %{fresh | transfers: place.transfers}}
      {:raise, exception} -> {:error, exception}
      {:error, reason} -> {:error, reason}
    end
  end

  @doc "Disconnects the device, and clears its fault."
  @spec unplug(t()) :: t()
  def unplug(place), do: %{clear_fault(place) | plugged?: false}

  @doc """
  Sets the device's fault.

  Returns `{:raise, exception}` or `{:error, reason}` when a twin cannot be powered up.
  """
  @spec put_fault(t(), Fault.t(), integer()) ::
          {:ok, t()} | {:error, term()} | {:raise, Exception.t()}
  def put_fault(place, {:twin, device} = fault, now_ns) do
    with {:ok, twin} <- new(device, now_ns),
         do: {:ok, %{clear_fault(place) | fault: fault, twin: twin}}
  end

  def put_fault(place, fault, _now_ns),
    do: {:ok, %{clear_fault(place) | fault: fault, dice: Fault.dice(fault)}}

  @doc "Clears the device's fault."
  @spec clear_fault(t()) :: t()
  def clear_fault(place), do: %{place | fault: nil, twin: nil, dice: nil}

  @doc """
  Makes one attempt of a transfer.

  Returns the answer, for how many milliseconds the device holds the bus beyond the time of the
  bytes, and the place. The place is `nil` at an address that never had a device.
  """
  @spec attempt(t() | nil, request(), timeout_ms :: pos_integer(), integer()) ::
          {answer(), held_ms :: non_neg_integer(), t() | nil}
  def attempt(nil, _request, _timeout_ms, _now_ns), do: {{:error, :i2c_nak}, 0, nil}

  def attempt(%{plugged?: false} = place, _request, _timeout_ms, _now_ns),
    do: {{:error, :i2c_nak}, 0, place}

  def attempt(place, request, timeout_ms, now_ns) do
    {kind, fault} = Fault.next(place.fault)
    attempt_with(kind, %{place | fault: fault}, request, timeout_ms, now_ns)
  end

  @doc """
  Returns the pulses of the device's interrupt pin (`c:BB.Bus.Sim.Device.pulses/3`), or `nil` when
  its model makes none.
  """
  @spec pulses(t(), integer(), integer()) :: map() | nil
  def pulses(%{plugged?: true, broken?: false} = place, from_ns, to_ns) do
    if function_exported?(place.module, :pulses, 3) do
      with %{line: _, times_ns: _, width_ns: _, next_ns: _} = pulses <-
             place.module.pulses(from_ns, to_ns, place.state),
           do: pulses,
           else: (_other -> nil)
    end
  catch
    _kind, _reason -> nil
  end

  def pulses(_place, _from_ns, _to_ns), do: nil

  # With the fault of this attempt, nil for none.

  defp attempt_with(nil, place, request, _timeout_ms, now_ns) do
    {answer, place} = call_model(place, request, now_ns)
    {answer, 0, place}
  end

  defp attempt_with({:slow, ms}, place, request, timeout_ms, now_ns) when ms < timeout_ms do
    {answer, place} = call_model(place, request, now_ns)
    {answer, ms, place}
  end

  defp attempt_with(kind, place, _request, timeout_ms, _now_ns)
       when kind == :timeout or elem(kind, 0) == :slow,
       do: {{:error, :timeout}, timeout_ms, place}

  defp attempt_with({:twin, _device}, place, request, _timeout_ms, now_ns) do
    {one, place} = call_model(place, request, now_ns)
    {other, twin} = call_model(place.twin, request, now_ns)
    {wired_and(one, other), 0, %{place | twin: twin}}
  end

  defp attempt_with({:bit_errors, probability, _seed}, place, request, timeout_ms, now_ns),
    do: attempt_with({:bit_errors, probability}, place, request, timeout_ms, now_ns)

  defp attempt_with({:bit_errors, probability}, place, {data, count}, _timeout_ms, now_ns) do
    {data, dice} = corrupt(data, probability, place.dice)
    {answer, place} = call_model(place, {data, count}, now_ns)
    {answer, dice} = corrupt(answer, probability, dice)
    {answer, 0, %{place | dice: dice}}
  end

  defp attempt_with(failure, place, _request, _timeout_ms, _now_ns),
    do: {{:error, Fault.error(failure)}, 0, place}

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

  defp call_model(%{broken?: true} = place, _request, _now_ns), do: {{:error, :i2c_nak}, place}

  defp call_model(place, request, now_ns) do
    case exchange(place, request, now_ns) do
      {:nak, state} -> {{:error, :i2c_nak}, %{place | state: state}}
      {answer, state} -> {answer, %{place | state: state, transfers: place.transfers + 1}}
    end
  catch
    kind, reason -> mark_broken(place, kind, reason, __STACKTRACE__)
  end

  defp exchange(place, {data, nil}, now_ns), do: write(place, data, now_ns)

  defp exchange(place, {data, count}, now_ns) do
    with {:ok, state} <- write(place, data, now_ns), do: read(place.module, count, now_ns, state)
  end

  # A transfer without bytes is only the address, which the device acknowledges.
  defp write(place, data, _now_ns) when data in [nil, <<>>], do: {:ok, place.state}

  defp write(place, data, now_ns) do
    case place.module.write(data, now_ns, place.state) do
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

  defp mark_broken(place, kind, reason, stacktrace) do
    Logger.error(
      "simulated device #{inspect(place.module)} is broken until it is plugged in again: " <>
        Exception.format(kind, reason, stacktrace)
    )

    {{:error, :i2c_nak}, %{place | broken?: true}}
  end
end
