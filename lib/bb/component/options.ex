defmodule BB.Component.Options do
  @moduledoc """
  The options of a component, checked against its module's schema.
  """

  alias BB.Options
  alias BB.Options.ValidationError

  @doc """
  The options with defaults, or the error, whose `keys_path` begins with the component's path: its message ends in
  ` (in options [:base_link, :imu])`.
  """
  @spec check(module(), keyword(), [atom()]) :: {:ok, keyword()} | {:error, ValidationError.t()}
  def check(module, options, path) do
    with {:error, %ValidationError{} = error} <- Options.validate(options, schema(module)),
         do: {:error, %{error | keys_path: path ++ error.keys_path}}
  end

  defp schema(module) do
    if Code.ensure_loaded?(module) and function_exported?(module, :options_schema, 0),
      do: module.options_schema(),
      else: []
  end
end
