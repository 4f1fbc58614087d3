defmodule BB.Bus.Sim.Mpu6050.Source do
  @moduledoc """
  The motion that the simulated MPU-6050 measures, from its option `:source`.

  `BB.Bus.Sim.Mpu6050` uses it. The option is one of

  - `:motion`: the built-in motion (`BB.Bus.Sim.Motion`);
  - a function of the seconds since power-on that returns a `t:BB.Bus.Sim.Motion.sample/0`;
  - `{:recording, recording}` or `{:recording, recording, speed: 1, at_end: :loop}`: a recording
    that plays from power-on, in real time or `speed` times as fast. It repeats (`:loop`) or stays
    at its last sample (`:hold`);
  - `{:stepped, recording}` or `{:stepped, samples}`: a source without time. Each burst read of
    the data takes the next sample, so none is left out or read twice at any rate. After the last
    sample it does not change.

  The module is pure.

      iex> alias BB.Bus.Sim.Mpu6050.Source
      iex> {:first, source} = Source.next(Source.new({:stepped, [:first, :last]}))
      iex> {:last, source} = Source.next(source)
      iex> Source.next(source)
      :end
  """
  alias BB.Bus.Sim.{Motion, Recording}

  @typedoc "The option `:source`."
  @type spec ::
          :motion
          | (number() -> Motion.sample())
          | {:recording, Recording.t()}
          | {:recording, Recording.t(), keyword()}
          | {:stepped, Recording.t() | [Motion.sample(), ...]}

  @typedoc "A source."
  @opaque t :: {:function, (number() -> Motion.sample())} | {:stepped, [Motion.sample(), ...]}

  @doc "Returns the source of an option. Raises `ArgumentError` for a wrong one."
  @spec new(spec()) :: t()
  def new(:motion), do: {:function, &Motion.at/1}
  def new(function) when is_function(function, 1), do: {:function, function}
  def new({:recording, recording}), do: new({:recording, recording, []})

  def new({:recording, %Recording{} = recording, opts}) do
    {speed, at_end} = playback!(opts)
    {:function, fn seconds -> Recording.at(recording, seconds * speed, at_end) end}
  end

  def new({:stepped, %Recording{} = recording}), do: {:stepped, Recording.samples(recording)}
  def new({:stepped, [_ | _] = samples}), do: {:stepped, samples}

  def new(other) do
    raise ArgumentError,
          "expected a source: :motion, a function of time, " <>
            "{:recording, recording, speed:, at_end:} or {:stepped, recording}, " <>
            "got: #{inspect(other, limit: 5)}"
  end

  @doc "Returns whether the source has no time."
  @spec stepped?(t()) :: boolean()
  def stepped?({kind, _}), do: kind == :stepped

  @doc "Returns the sample at `seconds` since power-on, of a source with time."
  @spec at(t(), number()) :: Motion.sample()
  def at({:function, function}, seconds), do: function.(seconds)

  @doc "Returns the next sample of a stepped source, or `:end` after the last."
  @spec next(t()) :: {Motion.sample(), t()} | :end
  def next({:stepped, [sample | rest]}), do: {sample, {:stepped, rest}}
  def next({:stepped, []}), do: :end

  defp playback!(opts) do
    case Keyword.validate(opts, speed: 1, at_end: :loop) do
      {:ok, opts} ->
        check!(opts[:speed], opts[:at_end])

      {:error, unknown} ->
        raise ArgumentError,
              "unknown options #{inspect(unknown)} of a recording, expected: speed:, at_end:"
    end
  end

  defp check!(speed, at_end) when is_number(speed) and speed > 0 and at_end in [:loop, :hold],
    do: {speed, at_end}

  defp check!(speed, at_end) do
    raise ArgumentError,
          "expected speed: a number above 0 and at_end: :loop or :hold, " <>
            "got: speed: #{inspect(speed)}, at_end: #{inspect(at_end)}"
  end
end
