defmodule BB.Bus.Sim.Encoder do
  @moduledoc """
  A simulated quadrature encoder on a shaft that turns at a velocity.

  Use it to run `BB.Sensor.QuadratureEncoder` without an encoder.

      encoder = {BB.Bus.Sim.Encoder, pins: [a: 5, b: 6], pulses: 11, velocity: 6.28}
      BB.Bus.Sim.Lines.plug("gpiochip0", :encoder, encoder)
      BB.Bus.Sim.Lines.tell("gpiochip0", :encoder, {:velocity, -6.28})

  Forwards, A leads B by a quarter of a period. Its outputs drive their lines high and low. Each
  edge is exactly at its time.

  ## Options

  - `:pulses`: pulses of one channel in a turn; required;
  - `:velocity`: the velocity of the shaft in rad/s; default 0.0.

  Its orders (`BB.Bus.Sim.Lines.tell/3`) are `{:velocity, rad_per_s}`, and `{:turn, counts}`,
  which makes all its edges at once.
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

    # In the middle of a count, so that the first edge takes equally long in both directions.
    encoder = %__MODULE__{
      per_radian: 4 * pulses / (2 * :math.pi()),
      rate: 0.0,
      from_ns: now_ns,
      from: 0.5,
      count: 0
    }

    {encoder, effects} = set_velocity(encoder, opts[:velocity], now_ns)
    {:ok, encoder, levels(encoder) ++ effects}
  end

  @impl true
  def order({:velocity, velocity}, now_ns, encoder) when is_number(velocity) do
    {encoder, effects} = set_velocity(encoder, velocity, now_ns)
    {encoder, [:cancel | effects]}
  end

  def order({:turn, counts}, now_ns, encoder) when is_integer(counts) do
    step = if counts < 0, do: -1, else: 1

    effects =
      for n <- 1..abs(counts)//1,
          do: levels(%{encoder | count: encoder.count + n * step})

    from = position(encoder, now_ns) + counts
    moved = %{encoder | count: encoder.count + counts, from: from, from_ns: now_ns}
    {moved, Enum.concat(effects) ++ [:cancel | next_edge(moved)]}
  end

  def order(_order, _now_ns, _encoder), do: :error

  @impl true
  def due({:count, count}, _now_ns, encoder) do
    encoder = %{encoder | count: count}
    {encoder, levels(encoder) ++ next_edge(encoder)}
  end

  defp set_velocity(encoder, velocity, now_ns) do
    from = position(encoder, now_ns)
    encoder = %{encoder | from: from, from_ns: now_ns, rate: velocity * encoder.per_radian}
    {encoder, next_edge(encoder)}
  end

  # In counts. Count n is the range from n to n + 1.
  defp position(encoder, now_ns),
    do: encoder.from + encoder.rate * (now_ns - encoder.from_ns) / 1.0e9

  defp next_edge(%{rate: rate}) when rate == 0, do: []
  defp next_edge(%{rate: rate} = encoder) when rate > 0, do: [at(encoder, encoder.count + 1, 1)]
  defp next_edge(encoder), do: [at(encoder, encoder.count, -1)]

  defp at(encoder, border, step) do
    after_ns = round((border - encoder.from) / encoder.rate * 1.0e9)
    {:at, encoder.from_ns + after_ns, {:count, encoder.count + step}}
  end

  defp levels(%{count: count}) do
    quarter = Integer.mod(count, 4)

    [
      {:drive, :a, if(quarter in [1, 2], do: 1, else: 0)},
      {:drive, :b, if(quarter in [2, 3], do: 1, else: 0)}
    ]
  end
end
