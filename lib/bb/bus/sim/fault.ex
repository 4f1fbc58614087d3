defmodule BB.Bus.Sim.Fault do
  @moduledoc """
  What is wrong with a simulated device, and for how long. Pure; used through `BB.Bus.Sim.fault/3`.
  """

  @typedoc "One way to fail; the error atom is Circuits' name for it, except that `:nak` reads as `:i2c_nak`."
  @type kind :: :nak | :enxio | :timeout | :retry | {:errno, pos_integer()}

  @typedoc "A way to fail until cleared, or for a number of attempts."
  @type t :: kind() | {kind(), pos_integer()}

  defguardp is_kind(kind)
            when kind in [:nak, :enxio, :timeout, :retry] or
                   (is_tuple(kind) and tuple_size(kind) == 2 and elem(kind, 0) == :errno and
                      is_integer(elem(kind, 1)) and elem(kind, 1) > 0)

  @doc "The fault itself; raises `ArgumentError` when it is none."
  @spec check!(t()) :: t()
  def check!(kind) when is_kind(kind), do: kind

  def check!({kind, times} = fault) when is_kind(kind) and is_integer(times) and times > 0,
    do: fault

  def check!(other) do
    raise ArgumentError,
          "expected a fault: :nak, :enxio, :timeout, :retry, {:errno, n} or {one of these, times}, got: #{inspect(other)}"
  end

  @doc """
  What one attempt meets: its error, or `nil` where nothing is wrong, and the fault that is left.

      iex> BB.Bus.Sim.Fault.meet({:nak, 2})
      {:i2c_nak, {:nak, 1}}
      iex> BB.Bus.Sim.Fault.meet({:nak, 1})
      {:i2c_nak, nil}
      iex> BB.Bus.Sim.Fault.meet(:timeout)
      {:timeout, :timeout}
      iex> BB.Bus.Sim.Fault.meet(nil)
      {nil, nil}
  """
  @spec meet(t() | nil) ::
          {:i2c_nak | :enxio | :timeout | :retry | {:errno, pos_integer()} | nil, t() | nil}
  def meet(nil), do: {nil, nil}
  def meet(kind) when is_kind(kind), do: {error(kind), kind}
  def meet({kind, 1}), do: {error(kind), nil}
  def meet({kind, times}), do: {error(kind), {kind, times - 1}}

  defp error(:nak), do: :i2c_nak
  defp error(kind), do: kind
end
