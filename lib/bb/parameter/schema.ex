defmodule BB.Parameter.Schema do
  @moduledoc """
  The parameters of a robot as a schema of `BB.Options`, flat or nested. Pure. Use it to check or
  to show a keyword list of parameters, such as the `params:` of `start_link/1`.

      iex> flat = [{[:arm, :gain], [type: :float, default: 1.0]}, {[:debug], [type: :boolean]}]
      iex> BB.Parameter.Schema.build_nested_schema(flat)
      [arm: [type: :keyword_list, keys: [gain: [type: :float]]], debug: [type: :boolean]]

  A robot's module returns its own flat schema by `MyRobot.__bb_parameter_schema__()`, and its
  defaults by `MyRobot.__bb_default_parameters__()`.
  """

  alias BB.Parameter.{Definition, Type}

  @typedoc "Each parameter by its path, with the description of an option of `BB.Options`."
  @type flat :: [{BB.Parameter.path(), keyword()}]

  @doc """
  Nests a flat schema: a path of several names becomes options inside options. The names are
  sorted.

  `:default` and `:required` are removed, because the nested schema checks values that replace
  others: an absent value stays as it is. Raises `ArgumentError` when one path is above another.
  """
  @spec build_nested_schema(flat()) :: keyword()
  def build_nested_schema(flat) do
    flat
    |> Enum.group_by(fn {[name | _path], _spec} -> name end)
    |> Enum.sort()
    |> Enum.map(&entry/1)
  end

  defp entry({name, [{[_name], spec}]}), do: {name, Keyword.drop(spec, [:default, :required])}

  defp entry({name, flat}) do
    if List.keymember?(flat, [name], 0),
      do:
        raise(ArgumentError, "expected one parameter or a group at #{inspect([name])}, got both")

    nested = for {[_name | path], spec} <- flat, do: {path, spec}
    {name, [type: :keyword_list, keys: build_nested_schema(nested)]}
  end

  @doc """
  Flattens nested parameters to `[{path, value}]`.

  A keyword list with elements is a level; an empty list is a value.

      iex> BB.Parameter.Schema.flatten_params(arm: [gain: 1.0, names: []], debug: true)
      [{[:arm, :gain], 1.0}, {[:arm, :names], []}, {[:debug], true}]
  """
  @spec flatten_params(keyword()) :: [{BB.Parameter.path(), term()}]
  def flatten_params(params), do: Enum.flat_map(params, &flatten(&1, []))

  defp flatten({name, value}, above) do
    if value != [] and Keyword.keyword?(value),
      do: Enum.flat_map(value, &flatten(&1, [name | above])),
      else: [{Enum.reverse([name | above]), value}]
  end

  @doc """
  Returns the flat schema of definitions. The bounds are part of the types.

      iex> {:ok, gain} = BB.Parameter.Definition.new([:gain], type: :float, default: 1.0)
      iex> BB.Parameter.Schema.of_definitions([gain])
      [{[:gain], [type: :float, default: 1.0]}]
  """
  @spec of_definitions([Definition.t()]) :: flat()
  def of_definitions(definitions), do: for(each <- definitions, do: {each.path, spec(each)})

  defp spec(definition) do
    {:ok, type} = Type.option_type(definition.type, definition.min, definition.max)
    fields = for key <- [:doc, :default], do: {key, Map.fetch!(definition, key)}
    Type.spec(type) ++ Enum.reject(fields, &match?({_key, nil}, &1))
  end

  @doc "Returns the defaults of definitions, `[{path, value}]`, of those that have one."
  @spec defaults([Definition.t()]) :: [{BB.Parameter.path(), term()}]
  def defaults(definitions),
    do: for(%{path: path, default: default} <- definitions, default != nil, do: {path, default})
end
