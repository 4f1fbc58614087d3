defmodule BB.Bus.Sim.Fault do
  @moduledoc """
  Faults of simulated devices, and how long they last.

  Tests set them with `BB.Bus.Sim.fault/3`. The module is pure.

      iex> BB.Bus.Sim.Fault.next({:nak, 2})
      {:nak, {:nak, 1}}
  """

  @typedoc "A fault without an answer. Its name is its error; `:nak` is `:i2c_nak` in Circuits."
  @type failure :: :nak | :enxio | :timeout | :retry | {:errno, pos_integer()}

  @typedoc """
  A fault with a wrong answer:

  - `{:slow, ms}`: the device stretches the clock, and holds the bus that much longer. A handle
    whose timeout is not longer gets `{:error, :timeout}`;
  - `{:bit_errors, probability}`: one bit of a byte to or from the device is flipped with that
    probability (above 0, up to 1). With a `seed` (an integer) the same bits flip each time;
  - `{:twin, device}`: a second device answers at the address, powered up when the fault is set.
    Both get the bytes that are written, one acknowledgement is enough, and the bytes that are
    read are the bitwise AND of both, as on open-drain wires.
  """
  @type weakness ::
          {:slow, pos_integer()}
          | {:bit_errors, number()}
          | {:bit_errors, number(), seed :: integer()}
          | {:twin, BB.Bus.Sim.device()}

  @typedoc "A kind of fault."
  @type kind :: failure() | weakness()

  @typedoc "A fault until it is cleared, or for a number of attempts. A twin is never counted."
  @type t :: kind() | {kind(), pos_integer()}

  @failures [:nak, :enxio, :timeout, :retry]

  defguardp is_count(n) when is_integer(n) and n > 0

  @doc "Returns the fault, or raises `ArgumentError`."
  @spec check!(t()) :: t()
  def check!(fault) do
    if kind?(fault) or counted?(fault) do
      fault
    else
      raise ArgumentError,
            "expected a fault: :nak, :enxio, :timeout, :retry, {:errno, n}, {:slow, ms}, " <>
              "{:bit_errors, probability}, {:bit_errors, probability, seed}, {kind, times} or " <>
              "{:twin, {module, options}}, got: #{inspect(fault)}"
    end
  end

  @doc """
  Returns the kind of fault of the next attempt, `nil` for none, and the fault after it.

      iex> BB.Bus.Sim.Fault.next({:nak, 1})
      {:nak, nil}
      iex> BB.Bus.Sim.Fault.next({{:slow, 5}, 1})
      {{:slow, 5}, nil}
      iex> BB.Bus.Sim.Fault.next({:slow, 5})
      {{:slow, 5}, {:slow, 5}}
      iex> BB.Bus.Sim.Fault.next(nil)
      {nil, nil}
  """
  @spec next(t() | nil) :: {kind() | nil, t() | nil}
  def next(nil), do: {nil, nil}

  def next(fault) do
    case {kind?(fault), fault} do
      {true, kind} -> {kind, kind}
      {false, {kind, 1}} -> {kind, nil}
      {false, {kind, times}} -> {kind, {kind, times - 1}}
    end
  end

  @doc "Returns the error of a failure."
  @spec error(failure()) :: :i2c_nak | :enxio | :timeout | :retry | {:errno, pos_integer()}
  def error(:nak), do: :i2c_nak
  def error(failure), do: failure

  @doc """
  Returns the first random state of a fault, or `nil` for a fault without chance.

  A fault with a seed has the same random state each time.
  """
  @spec dice(t() | nil) :: :rand.state() | nil
  def dice({{:bit_errors, _, _} = kind, _times}), do: dice(kind)
  def dice({{:bit_errors, _} = kind, _times}), do: dice(kind)
  def dice({:bit_errors, _probability, seed}), do: :rand.seed_s(:exsss, seed)
  def dice({:bit_errors, _probability}), do: :rand.seed_s(:exsss)
  def dice(_other), do: nil

  @doc """
  Flips one bit of each byte with a probability.

      iex> dice = BB.Bus.Sim.Fault.dice({:bit_errors, 1, 7})
      iex> {bytes, _dice} = BB.Bus.Sim.Fault.corrupt(<<0, 0>>, 1, dice)
      iex> for <<bit::1 <- bytes>>, reduce: 0, do: (bits -> bits + bit)
      2
  """
  @spec corrupt(binary(), number(), :rand.state()) :: {binary(), :rand.state()}
  def corrupt(bytes, probability, dice) do
    for <<byte <- bytes>>, reduce: {<<>>, dice} do
      {done, dice} ->
        {byte, dice} = corrupt_byte(byte, probability, dice)
        {<<done::binary, byte>>, dice}
    end
  end

  defp corrupt_byte(byte, probability, dice) do
    {chance, dice} = :rand.uniform_s(dice)
    {bit, dice} = :rand.uniform_s(8, dice)
    flipped = Bitwise.bxor(byte, Bitwise.bsl(1, bit - 1))
    {if(chance < probability, do: flipped, else: byte), dice}
  end

  defp kind?(kind) when kind in @failures, do: true
  defp kind?({:errno, n}) when is_count(n), do: true
  defp kind?({:slow, ms}) when is_count(ms), do: true
  defp kind?({:bit_errors, p}), do: probability?(p)
  defp kind?({:bit_errors, p, seed}) when is_integer(seed), do: probability?(p)
  defp kind?({:twin, {module, opts}}) when is_atom(module) and is_list(opts), do: true
  defp kind?(_), do: false

  defp counted?({{:twin, _}, _times}), do: false
  defp counted?({kind, times}) when is_count(times), do: kind?(kind)
  defp counted?(_), do: false

  defp probability?(p), do: is_number(p) and p > 0 and p <= 1
end
