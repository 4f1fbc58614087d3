defmodule BB.Callback.TelemetryHandlersTest do
  @moduledoc "A telemetry handler fails in every way, without an effect on other processes."
  use ExUnit.Case, async: true

  import BB.Test.Neighbourhood

  alias BB.Test.Mischief

  @moduletag :tmp_dir

  describe "a telemetry handler" do
    @events [
      [:bb, :loop, :tick],
      [:bb, :sensor, :status],
      [:bb, :sensor, :init, :start],
      [:bb, :sensor, :init, :stop],
      [:bb, :safety, :transition],
      [:bb, :safety, :disarm, :start],
      [:bb, :safety, :disarm, :stop]
    ]

    def handle(event, _measurements, %{robot: robot}, {robot, event, kind}),
      do: Mischief.perform({robot, event}, kind)

    def handle(_event, _measurements, _metadata, _config), do: :ok

    # Each event has a handler of its own, so that none is detached before another runs.
    defp attach(robot, kind) do
      for event <- @events do
        on_exit(fn -> BB.Telemetry.detach({robot, event}) end)
        BB.Telemetry.attach({robot, event}, event, &__MODULE__.handle/4, {robot, event, kind})
      end
    end

    for kind <- Mischief.kinds() do
      @tag kind: kind
      test "does not hurt others: #{kind}", %{kind: kind} = context do
        robot = declared(sensor(Mischief.driver(:explain, :raise)))
        attach(robot, kind)
        root = start(robot)
        neighbour = BB.Process.whereis(robot, :neighbour)
        happens!({robot, [:bb, :loop, :tick]})
        unnoticed!(robot, root, neighbour, context)
        for event <- @events, do: happens!({robot, event})
      end
    end
  end
end
