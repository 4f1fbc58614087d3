defmodule BB.Component.OptionsSchema do
  @moduledoc """
  Checks options against the schema of a callback module.

  `BB.Component.Resolution` uses it for the options of a component. The options that the framework
  adds are no part of the schema:

      iex> options = [bus: "i2c-1", bb: %{robot: MyRobot, path: [:imu]}]
      iex> {:ok, options} =
      ...>   BB.Component.OptionsSchema.validate(BB.Sensor.Mpu6050, options, [:bb])
      iex> {options[:bb].path, options[:address]}
      {[:imu], 0x68}
  """

  alias BB.Options
  alias BB.Options.ValidationError

  @doc """
  Checks the options of a module, and fills in the defaults.

  The options with one of the `framework_keys` are not checked and do not change. A module
  without a schema takes no other options.
  """
  @spec validate(module(), keyword(), [atom()]) ::
          {:ok, keyword()} | {:error, ValidationError.t()}
  def validate(module, options, framework_keys) do
    {framework, own} = Keyword.split(options, framework_keys)
    with {:ok, own} <- Options.validate(own, schema(module)), do: {:ok, framework ++ own}
  end

  defp schema(module) do
    if Code.ensure_loaded?(module) and function_exported?(module, :options_schema, 0),
      do: module.options_schema(),
      else: []
  end
end
