defmodule BB.Sensor.Conformance.Robot do
  @moduledoc """
  Makes the robot of a conformance test: a module whose only sensor is the driver under test.

  `BB.Sensor.Conformance.Rig` makes one for each test. The driver's options that the test is going
  to change are parameters of the robot.
  """
  @moduledoc no_example: "internal: `use BB.Sensor.Conformance` makes the robots"

  alias BB.Sensor.Conformance.Setting

  @sensor :subject

  @doc "Compiles the module of a robot whose driver is at the given place."
  @spec create(module(), Setting.t(), map()) :: :ok
  def create(robot, setting, place) do
    %{driver: driver, new_options: new} = setting
    options = driver_options(setting, place)

    params =
      for {key, value} <- new do
        default = Setting.option(driver, options, key)
        quote do: param(unquote(key), type: unquote(type(value)), default: unquote(default))
      end

    options = Enum.reduce(Keyword.keys(new), options, &Keyword.put(&2, &1, {:reference, &1}))

    code =
      quote do
        use BB

        parameters do
          (unquote_splicing(params))
        end

        sensors do
          sensor(unquote(@sensor), {unquote(driver), unquote(quoted(options))},
            max_silence: unquote(Macro.escape(max_silence(setting)))
          )
        end
      end

    # The path of the machine that compiles this module has no meaning where the robot is made.
    {:module, ^robot, _, _} = Module.create(robot, code, file: "conformance.ex", line: 1)
    :ok
  end

  # Long enough that a busy machine does not make a driver stale, and short enough that a silent
  # driver is found in time.
  defp max_silence(setting), do: BB.Unit.new!(div(setting.patience_ms, 3), :millisecond)

  defp driver_options(%{options: options}, place) when is_function(options, 1),
    do: options.(place)

  defp driver_options(setting, place),
    do: Keyword.merge(setting.wires.options(place), setting.options)

  defp quoted(options) do
    for {key, value} <- options do
      case value do
        {:reference, name} -> {key, quote(do: param([unquote(name)]))}
        value -> {key, Macro.escape(value)}
      end
    end
  end

  defp type(value) when is_boolean(value), do: :boolean
  defp type(value) when is_integer(value), do: :integer
  defp type(value) when is_float(value), do: :float
  defp type(value) when is_binary(value), do: :string
  defp type(value) when is_atom(value), do: :atom
end
