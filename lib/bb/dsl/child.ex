defmodule BB.Dsl.Child do
  @moduledoc """
  Parses and checks a child of a declaration: a callback module, alone or with its options.
  Components, simulated devices and the parameter store are children. `BB.Dsl.Rules` and
  `BB.Dsl.Compiler` use it.

      iex> BB.Dsl.Child.parse({BB.Sensor.Mpu6050, bus: "i2c-1"})
      {:ok, BB.Sensor.Mpu6050, [bus: "i2c-1"]}
      iex> BB.Dsl.Child.parse(BB.Sensor.Mpu6050)
      {:ok, BB.Sensor.Mpu6050, []}
  """

  @doc "Parses a child: `{:ok, module, options}`, or `{:error, reason}`."
  @spec parse(term()) :: {:ok, module(), keyword()} | {:error, String.t()}
  def parse({module, options}) when is_atom(module) and not is_nil(module) do
    if Keyword.keyword?(options),
      do: {:ok, module, options},
      else:
        {:error,
         "expected keywords for the options of #{inspect(module)}, got: #{inspect(options)}"}
  end

  def parse(module) when is_atom(module) and not is_nil(module), do: {:ok, module, []}
  def parse(other), do: {:error, "expected a module or {module, options}, got: #{inspect(other)}"}

  @doc """
  Checks that the module of a child implements `behaviour`, and that its options can be compiled
  into the robot's module.
  """
  @spec check(term(), module()) :: :ok | {:error, String.t()}
  def check(child, behaviour) do
    with {:ok, module, _options} <- parse(child),
         :ok <- check_exists(module),
         do: check_if_loaded(child, behaviour)
  end

  @doc """
  Checks a child as `check/2` does, but its module only if it can be loaded.
  """
  @spec check_if_loaded(term(), module()) :: :ok | {:error, String.t()}
  def check_if_loaded(child, behaviour) do
    with {:ok, module, options} <- parse(child),
         :ok <- check_behaviour(module, behaviour),
         do: check_options(options)
  end

  @doc "Checks that the options of a child can be compiled into the robot's module."
  @spec check_constant(term()) :: :ok | {:error, String.t()}
  def check_constant(child),
    do: with({:ok, _module, options} <- parse(child), do: check_options(options))

  # An unavailable module waits for this robot to compile.
  defp check_exists(module) do
    case Code.ensure_compiled(module) do
      {:error, reason} when reason != :unavailable ->
        {:error,
         "module #{inspect(module)} does not exist; correct its name, " <>
           "or define it above the robot or in a file of its own"}

      _ ->
        :ok
    end
  end

  defp check_behaviour(module, behaviour) do
    case Code.ensure_compiled(module) do
      {:module, _} -> check_declared(module, behaviour)
      {:error, _} -> :ok
    end
  end

  defp check_declared(module, behaviour) do
    if BB.Component.implements?(module, behaviour) do
      :ok
    else
      {:error,
       "#{inspect(module)} must implement the #{inspect(behaviour)} behaviour; " <>
         "add `#{declaration(behaviour)}` to it"}
    end
  end

  defp declaration(behaviour) do
    if Code.ensure_loaded?(behaviour) and macro_exported?(behaviour, :__using__, 1),
      do: "use #{inspect(behaviour)}",
      else: "@behaviour #{inspect(behaviour)}"
  end

  defp check_options(options) do
    case Enum.find(options, fn {_key, value} -> not constant?(value) end) do
      nil -> :ok
      {key, value} -> {:error, not_constant(key, value)}
    end
  end

  defp not_constant(key, value) do
    """
    option #{inspect(key)} cannot be part of a compiled module, got: #{inspect(value)}; \
    write a function as `fn` or & in the option itself, and name a process by its registered name\
    """
  end

  defp constant?(value) when is_function(value),
    do: Function.info(value, :type) == {:type, :external}

  defp constant?(value) when is_pid(value) or is_port(value) or is_reference(value), do: false
  defp constant?([head | tail]), do: constant?(head) and constant?(tail)
  defp constant?(value) when is_tuple(value), do: value |> Tuple.to_list() |> constant?()
  defp constant?(value) when is_map(value), do: value |> :maps.to_list() |> constant?()
  defp constant?(_value), do: true
end
