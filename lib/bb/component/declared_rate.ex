defmodule BB.Component.DeclaredRate do
  @moduledoc """
  The rates that components declare (`c:BB.Sensor.rate/1`) for their current options.

  `BB.Component.PublishRate` shows them beside the measured rates.

  Each component's `rate/1` is called once for each set of options, whatever it returns; calls
  that are due run at the same time. The results are kept in the robot's registry.
  """
  @moduledoc no_example: "internal: BB.Sensor.health/1 shows the rates"

  alias BB.{Callback, Component, Parameter}
  alias BB.Component.{OptionsCheck, Resolution}

  # Callers divide by a rate. A component that publishes less than once in a day has none.
  @least_hz 0.00001
  @most_hz 1_000_000_000

  @doc """
  Returns the declared rates in Hz of the given components of a robot, in their order.

  The rate of a component that declares none is `nil`.
  """
  @spec list(module(), [Component.t()]) :: [number() | nil]
  def list(robot, components) do
    looked_up = Enum.map(components, &look_up(robot, &1))
    unknown = for {:unknown, component, values} <- looked_up, do: {component, values}
    called = call_all(robot, unknown)

    Enum.map(looked_up, fn
      {:known, rate_hz} -> rate_hz
      {:unknown, component, _values} -> Map.fetch!(called, component.name)
    end)
  end

  defp look_up(robot, %{module: module} = component) do
    if Code.ensure_loaded?(module) and function_exported?(module, :rate, 1),
      do: look_up(robot, component, parameter_values(robot, component)),
      else: {:known, nil}
  end

  defp look_up(_robot, _component, nil), do: {:known, nil}

  defp look_up(robot, component, values) do
    registry = BB.Process.registry_module(robot)

    case registry.meta(BB.Process.registry_name(robot), key(component)) do
      {:ok, {^values, rate_hz}} -> {:known, rate_hz}
      _other -> {:unknown, component, values}
    end
  rescue
    # The registry is being restarted.
    ArgumentError -> {:known, nil}
  end

  defp parameter_values(robot, component) do
    paths = robot |> Resolution.of(component) |> Resolution.paths()
    Map.new(paths, &{&1, Parameter.get!(robot, &1)})
  rescue
    # The parameters are being restarted.
    ArgumentError -> nil
  end

  # Calls

  defp call_all(_robot, []), do: %{}

  defp call_all(robot, unknown) do
    unknown
    |> Enum.map(fn {component, values} -> {Resolution.of(robot, component), values} end)
    |> OptionsCheck.run()
    |> Enum.zip(unknown)
    |> Enum.map(fn {checked, {component, values}} ->
      {component, values, start_call(checked, component)}
    end)
    |> Map.new(fn {component, values, call} ->
      {component.name, store_result(robot, component, values, await(call))}
    end)
  end

  defp start_call({:ok, options}, %{module: module}) do
    Callback.start({module, :rate, [options]},
      accept: &rate_hz/1,
      expected: "a number of Hz from #{@least_hz} to #{@most_hz}, or nil",
      instead: "health shows no declared rate"
    )
  end

  defp start_call({:error, _error}, _component), do: nil

  defp await(nil), do: {:ok, nil}
  defp await(call), do: Callback.await(call)

  # A call that timed out, perhaps since the machine stood still for a moment, is made again next
  # time. BB.Callback limits how often.
  defp store_result(_robot, _component, _values, {:error, {:timeout, _ms}}), do: nil

  defp store_result(robot, component, values, {:error, _failure}),
    do: store(robot, component, values, nil)

  defp store_result(robot, component, values, {:ok, rate_hz}),
    do: store(robot, component, values, rate_hz)

  @doc false
  @spec rate_hz(term()) :: {:ok, number() | nil} | :error
  def rate_hz(nil), do: {:ok, nil}

  def rate_hz(rate_hz) when is_number(rate_hz) and rate_hz >= @least_hz and rate_hz <= @most_hz,
    do: {:ok, rate_hz}

  def rate_hz(_other), do: :error

  defp store(robot, component, values, rate_hz) do
    registry = BB.Process.registry_name(robot)
    :ok = BB.Process.registry_module(robot).put_meta(registry, key(component), {values, rate_hz})
    rate_hz
  rescue
    ArgumentError -> rate_hz
  end

  defp key(component), do: {:declared_rate, component.name}
end
