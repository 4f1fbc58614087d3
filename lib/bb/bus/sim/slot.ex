defmodule BB.Bus.Sim.Slot do
  @moduledoc """
  One address of a simulated bus: the device's model with its state, and what is wrong with it.

  Pure but for the log entry of a model that raised. A slot outlives its device's wires: it stays when the device is unplugged.
  """
  require Logger

  alias BB.Bus.Sim.Fault

  @enforce_keys [:module, :opts, :state]
  defstruct [:module, :opts, :state, fault: nil, plugged?: true, broken?: false, transfers: 0]

  @type t :: %__MODULE__{}

  @typedoc "What a transfer asks for: bytes to write (or `nil`) and a count to read (or `nil`)."
  @type request :: {binary() | nil, non_neg_integer() | nil}

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

  @doc "One attempt of a transfer: its answer, and the slot after it. `nil` is an address where nothing ever was."
  @spec attempt(t() | nil, request(), integer()) ::
          {:ok | {:ok, binary()} | {:error, term()}, t() | nil}
  def attempt(nil, _request, _now_ns), do: {{:error, :i2c_nak}, nil}
  def attempt(%{plugged?: false} = slot, _request, _now_ns), do: {{:error, :i2c_nak}, slot}
  def attempt(%{broken?: true} = slot, _request, _now_ns), do: {{:error, :i2c_nak}, slot}

  def attempt(slot, request, now_ns) do
    case Fault.meet(slot.fault) do
      {nil, nil} -> perform(slot, request, now_ns)
      {error, fault} -> {{:error, error}, %{slot | fault: fault}}
    end
  end

  defp perform(slot, request, now_ns) do
    case exchange(slot, request, now_ns) do
      {:nak, state} -> {{:error, :i2c_nak}, %{slot | state: state}}
      {answer, state} -> {answer, %{slot | state: state, transfers: slot.transfers + 1}}
    end
  rescue
    exception -> broke(slot, :error, exception, __STACKTRACE__)
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
      {:ok, <<bytes::binary-size(count)>>, state} -> {{:ok, bytes}, state}
      {:nak, state} -> {:nak, state}
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
