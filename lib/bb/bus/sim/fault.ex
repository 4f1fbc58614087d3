defmodule BB.Bus.Sim.Fault do
  @moduledoc """
  What is wrong with a simulated device, and for how long. Pure; used through `BB.Bus.Sim.fault/3`.
  """

  @typedoc "A way to answer nothing; the error atom is Circuits' name for it, except that `:nak` reads as `:i2c_nak`."
  @type failure :: :nak | :enxio | :timeout | :retry | {:errno, pos_integer()}

  @typedoc """
  A way to answer badly:

  - `{:slow, ms}`: the device stretches the clock and so holds the bus that much longer; a handle whose timeout is not longer gets `{:error, :timeout}`;
  - `{:bit_errors, probability}`: of each byte to and from the device one bit is flipped, with that probability (above 0, to 1);
    with a `seed` (an integer) the same bits each time;
  - `{:twin, device}`: a second device answers at the address. Both hear what is written, one of them is enough to acknowledge, and the
    bytes read are those of both, ANDed, as open-drain wires do it. It is powered up when the fault is made.
  """
  @type weakness ::
          {:slow, pos_integer()}
          | {:bit_errors, number()}
          | {:bit_errors, number(), seed :: integer()}
          | {:twin, BB.Bus.Sim.device()}

  @typedoc "One way to be wrong."
  @type kind :: failure() | weakness()

  @typedoc "A way to be wrong until cleared, or for a number of attempts (a twin: until cleared)."
  @type t :: kind() | {kind(), pos_integer()}

  @failures [:nak, :enxio, :timeout, :retry]

  defguardp is_count(n) when is_integer(n) and n > 0

  @doc "The fault itself; raises `ArgumentError` when it is none."
  @spec check!(t()) :: t()
  def check!(fault) do
    if kind?(fault) or counted?(fault) do
      fault
    else
      raise ArgumentError,
            "expected a fault: :nak, :enxio, :timeout, :retry, {:errno, n}, {:slow, ms}, {:bit_errors, probability}, " <>
              "{:bit_errors, probability, seed}, {one of these, times} or {:twin, {module, options}}, got: #{inspect(fault)}"
    end
  end

  @doc """
  What one attempt meets: the way it is wrong (`nil` where nothing is), and the fault that is left.

      iex> BB.Bus.Sim.Fault.next({:nak, 2})
      {:nak, {:nak, 1}}
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

  @doc "The error that a failure is read as."
  @spec error(failure()) :: :i2c_nak | :enxio | :timeout | :retry | {:errno, pos_integer()}
  def error(:nak), do: :i2c_nak
  def error(failure), do: failure

  @doc """
  Where a fault's chance begins: `nil` for a fault without any.

  A fault that has a seed begins at the same place each time.
  """
  @spec dice(t() | nil) :: :rand.state() | nil
  def dice({{:bit_errors, _, _} = kind, _times}), do: dice(kind)
  def dice({{:bit_errors, _} = kind, _times}), do: dice(kind)
  def dice({:bit_errors, _probability, seed}), do: :rand.seed_s(:exsss, seed)
  def dice({:bit_errors, _probability}), do: :rand.seed_s(:exsss)
  def dice(_other), do: nil

  @doc """
  Bytes as they come through wires that flip a bit of each with a probability.

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
