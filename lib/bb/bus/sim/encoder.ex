defmodule BB.Bus.Sim.Encoder do
  @moduledoc """
  A simulated quadrature encoder, whose shaft turns as it is told.

      BB.Bus.Sim.Lines.plug("gpiochip0", :encoder, {BB.Bus.Sim.Encoder, pins: [a: 5, b: 6], pulses: 11, velocity: 6.28})
      BB.Bus.Sim.Lines.tell("gpiochip0", :encoder, {:velocity, -6.28})

  Forwards, A leads B by a quarter of a period. Its outputs drive their lines both ways. Each edge is exactly at its time.

  ## Options
  - `:pulses`: of one channel in a turn; required;
  - `:velocity`: of the shaft, in rad/s; default 0.0.

  Orders: `{:velocity, rad_per_s}`; `{:turn, counts}`, at once and one after the other.
  """
  @behaviour BB.Bus.Sim.GPIO.Device

  @enforce_keys [:per_radian, :rate, :from_ns, :from, :count]
  defstruct [:per_radian, :rate, :from_ns, :from, :count]

  @impl true
  def pins, do: [:a, :b]

  @impl true
  def init(opts, now_ns) do
    opts = Keyword.validate!(opts, [:pulses, velocity: 0.0])
    pulses = opts[:pulses]

    unless is_integer(pulses) and pulses > 0 and is_number(opts[:velocity]) do
      raise ArgumentError,
            "expected pulses: a number above 0 and velocity: rad/s, got: #{inspect(opts)}"
    end

    # In the middle of a count, so that the first edge of either direction takes as long as the other's.
    encoder = %__MODULE__{
      per_radian: 4 * pulses / (2 * :math.pi()),
      rate: 0.0,
      from_ns: now_ns,
      from: 0.5,
      count: 0
    }

    {encoder, later} = turn(encoder, opts[:velocity], now_ns)
    {:ok, encoder, levels(encoder) ++ later}
  end

  @impl true
  def order({:velocity, velocity}, now_ns, encoder) when is_number(velocity) do
    {encoder, later} = turn(encoder, velocity, now_ns)
    {encoder, [:cancel | later]}
  end

  def order({:turn, counts}, now_ns, encoder) when is_integer(counts) do
    step = if counts < 0, do: -1, else: 1

    effects =
      for n <- 1..abs(counts)//1,
          do: levels(%{encoder | count: encoder.count + n * step})

    moved = %{encoder | count: encoder.count + counts, from: position(encoder, now_ns) + counts}
    moved = %{moved | from_ns: now_ns}
    {moved, Enum.concat(effects) ++ [:cancel | next(moved)]}
  end

  def order(_order, _now_ns, _encoder), do: :error

  @impl true
  def due({:count, count}, _now_ns, encoder) do
    encoder = %{encoder | count: count}
    {encoder, levels(encoder) ++ next(encoder)}
  end

  defp turn(encoder, velocity, now_ns) do
    from = position(encoder, now_ns)
    encoder = %{encoder | from: from, from_ns: now_ns, rate: velocity * encoder.per_radian}
    {encoder, next(encoder)}
  end

  # In counts; count n is from n to n + 1.
  defp position(encoder, now_ns),
    do: encoder.from + encoder.rate * (now_ns - encoder.from_ns) / 1.0e9

  defp next(%{rate: rate}) when rate == 0, do: []
  defp next(%{rate: rate} = encoder) when rate > 0, do: [at(encoder, encoder.count + 1, 1)]
  defp next(encoder), do: [at(encoder, encoder.count, -1)]

  defp at(encoder, border, step) do
    after_ns = round((border - encoder.from) / encoder.rate * 1.0e9)
    {:at, encoder.from_ns + after_ns, {:count, encoder.count + step}}
  end

  defp levels(%{count: count}) do
    place = Integer.mod(count, 4)

    [
      {:drive, :a, if(place in [1, 2], do: 1, else: 0)},
      {:drive, :b, if(place in [2, 3], do: 1, else: 0)}
    ]
  end
end
