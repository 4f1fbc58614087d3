defmodule BB.Test.Counter do
  @moduledoc "A sensor that publishes 0, 1, 2, … at 500 Hz, so that a gap or a restart shows."

  use BB.Sensor

  defmodule Count do
    @moduledoc "The payload of a `BB.Test.Counter`: its number."
    defstruct [:n]
    use BB.Message, schema: [n: [type: :non_neg_integer, required: true]]
  end

  @impl BB.Sensor
  def init(opts) do
    loop = BB.Loop.new(opts[:bb], clock: {:rate, 500}) |> BB.Loop.arm()
    {:ok, %{bb: opts[:bb], loop: loop, n: 0}}
  end

  @impl BB.Sensor
  def handle_info(:tick, state) do
    {_dt, _skipped, loop} = BB.Loop.tick(state.loop)
    {:ok, message} = Count.new(List.last(state.bb.path), n: state.n)
    BB.Sensor.publish(state.bb, message)
    {:noreply, %{state | loop: loop, n: state.n + 1}}
  end
end
