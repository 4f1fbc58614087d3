defmodule BB.Component.DeclaredRate do
  @moduledoc """
  How often components say that they publish (`c:BB.Sensor.rate/1`), with their options as they
  are now.

  A module is asked once for each set of options, whatever it answers, and all that have to be
  asked are asked at once. The answers stand in the robot's registry.
  """

  alias BB.{Callback, Component, Parameter}
  alias BB.Component.{OptionsCheck, Resolution}

  # Who computes with a rate divides by it. A sensor that publishes less than once in a day has
  # none.
  @least_hz 0.00001
  @most_hz 1_000_000_000

  @doc "The rates in Hz of components of a robot, in their order; `nil` where one declares none."
  @spec rates(module(), [Component.t()]) :: [number() | nil]
  def rates(robot, components) do
    known = Enum.map(components, &known(robot, &1))
    asked = ask(robot, for({:unknown, component, values} <- known, do: {component, values}))

    Enum.map(known, fn
      {:known, rate_hz} -> rate_hz
      {:unknown, component, _values} -> Map.fetch!(asked, component.name)
    end)
  end

  defp known(robot, %{module: module} = component) do
    if Code.ensure_loaded?(module) and function_exported?(module, :rate, 1),
      do: kept(robot, component, values(robot, component)),
      else: {:known, nil}
  end

  defp values(robot, component) do
    paths = robot |> Resolution.of(component) |> Resolution.paths()
    Map.new(paths, &{&1, Parameter.get!(robot, &1)})
  rescue
    # The parameters are being restarted.
    ArgumentError -> nil
  end

  # Asking

  defp ask(_robot, []), do: %{}

  defp ask(robot, unknown) do
    unknown
    |> Enum.map(fn {component, values} -> {Resolution.of(robot, component), values} end)
    |> OptionsCheck.run()
    |> Enum.zip(unknown)
    |> Enum.map(fn {checked, {component, values}} ->
      {component, values, start(checked, component)}
    end)
    |> Map.new(fn {component, values, call} ->
      {component.name, answer(robot, component, values, await(call))}
    end)
  end

  defp start({:ok, options}, %{module: module}) do
    Callback.start({module, :rate, [options]},
      accept: &rate_hz/1,
      expected: "a number of Hz from #{@least_hz} to #{@most_hz}, or nil",
      instead: "health shows no declared rate"
    )
  end

  defp start({:error, _refused}, _component), do: nil

  defp await(nil), do: {:ok, nil}
  defp await(call), do: Callback.await(call)

  # One that did not return, on a machine that stood still for a moment, is asked again; BB.Callback
  # sees to it that this is seldom.
  defp answer(_robot, _component, _values, {:error, {:timeout, _ms}}), do: nil

  defp answer(robot, component, values, {:error, _failure}),
    do: keep(robot, component, values, nil)

  defp answer(robot, component, values, {:ok, rate_hz}),
    do: keep(robot, component, values, rate_hz)

  @doc false
  @spec rate_hz(term()) :: {:ok, number() | nil} | :error
  def rate_hz(nil), do: {:ok, nil}

  def rate_hz(rate_hz) when is_number(rate_hz) and rate_hz >= @least_hz and rate_hz <= @most_hz,
    do: {:ok, rate_hz}

  def rate_hz(_other), do: :error

  # What is kept

  defp kept(_robot, _component, nil), do: {:known, nil}

  defp kept(robot, component, values) do
    case BB.Process.registry_module(robot).meta(BB.Process.registry_name(robot), key(component)) do
      {:ok, {^values, rate_hz}} -> {:known, rate_hz}
      _other -> {:unknown, component, values}
    end
  rescue
    # The registry is being restarted.
    ArgumentError -> {:known, nil}
  end

  defp keep(robot, component, values, rate_hz) do
    registry = BB.Process.registry_name(robot)
    :ok = BB.Process.registry_module(robot).put_meta(registry, key(component), {values, rate_hz})
    rate_hz
  rescue
    ArgumentError -> rate_hz
  end

  defp key(component), do: {:declared, component.name}
end
