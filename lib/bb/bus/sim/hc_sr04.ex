defmodule BB.Bus.Sim.HcSr04 do
  @moduledoc """
  A simulated HC-SR04, an ultrasonic range finder with a trigger and an echo pin.

  Use it to run `BB.Sensor.HcSr04` without the module.

      sonar = {BB.Bus.Sim.HcSr04, pins: [trigger: 23, echo: 24], distance: 0.5}
      BB.Bus.Sim.Lines.plug("gpiochip0", :sonar, sonar)
      BB.Bus.Sim.Lines.tell("gpiochip0", :sonar, {:distance, :infinity})

  When the trigger falls, the module sends its burst. 450 µs later the echo rises, for the time of
  sound to the obstacle and back, or for 38 ms without an obstacle. The module ignores the trigger
  until the echo has fallen. The width of the trigger pulse has no effect, because a stepped clock
  may stand still during the pulse.

  ## Options

  - `:distance`: the distance to the obstacle in m, or `:infinity`, or a function of the seconds
    since power-on that returns one of these; default 1.0;
  - `:speed_of_sound`: in m/s; default 343.2, as at 20 °C.

  Its order is `{:distance, distance}` (`BB.Bus.Sim.Lines.tell/3`).
  """
  @behaviour BB.Bus.Sim.GPIO.Device

  @burst_ns 450_000
  @no_echo_ns 38_000_000
  @farthest 4.5

  @enforce_keys [:distance, :speed, :powered_ns]
  defstruct [:distance, :speed, :powered_ns, :busy_until_ns]

  @impl true
  def pins, do: [:trigger, :echo]

  @impl true
  def init(opts, now_ns) do
    opts = Keyword.validate!(opts, distance: 1.0, speed_of_sound: 343.2)
    distance!(opts[:distance])

    module = %__MODULE__{
      distance: opts[:distance],
      speed: opts[:speed_of_sound],
      powered_ns: now_ns
    }

    {:ok, module, [{:drive, :echo, 0}]}
  end

  @impl true
  def level(:trigger, 0, now_ns, %{busy_until_ns: until_ns} = module)
      when until_ns == nil or now_ns >= until_ns do
    rise_ns = now_ns + @burst_ns
    fall_ns = rise_ns + width_ns(module, now_ns)

    {%{module | busy_until_ns: fall_ns},
     [{:drive, :echo, 1, rise_ns}, {:drive, :echo, 0, fall_ns}]}
  end

  def level(_pin, _level, _now_ns, module), do: {module, []}

  @impl true
  def order({:distance, distance}, _now_ns, module) do
    distance!(distance)
    {%{module | distance: distance}, []}
  end

  def order(_order, _now_ns, _module), do: :error

  defp width_ns(module, now_ns) do
    case distance(module, now_ns) do
      distance when is_number(distance) and distance < @farthest ->
        round(2 * distance / module.speed * 1.0e9)

      _far ->
        @no_echo_ns
    end
  end

  defp distance(%{distance: distance} = module, now_ns) when is_function(distance, 1),
    do: distance.((now_ns - module.powered_ns) / 1.0e9)

  defp distance(%{distance: distance}, _now_ns), do: distance

  defp distance!(distance) do
    unless distance == :infinity or is_function(distance, 1) or
             (is_number(distance) and distance >= 0) do
      raise ArgumentError,
            "expected a distance: m, :infinity or a function of seconds, " <>
              "got: #{inspect(distance)}"
    end
  end
end
