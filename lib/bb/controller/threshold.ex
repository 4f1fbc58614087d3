defmodule BB.Controller.Threshold do
  @shared BB.Controller.PatternMatch.options_schema().schema

  @options BB.Options.new!(
             topic: @shared[:topic],
             field: [
               type: {:or, [:atom, {:list, :any}]},
               required: true,
               doc: """
               The field of the payload, such as `:voltage`, or the way to it: \
               `[:linear_acceleration, :z]`.
               """
             ],
             min: [type: {:or, [:float, nil]}, doc: "The least value that is well."],
             max: [type: {:or, [:float, nil]}, doc: "The greatest value that is well."],
             action: @shared[:action],
             cooldown_ms: @shared[:cooldown_ms]
           )

  @moduledoc """
  A controller that acts when a number in a message is below or above a bound.

  Declare it to guard a reading:

      controllers do
        controller :brownout,
                   {BB.Controller.Threshold,
                    topic: [:sensor, :battery],
                    field: :voltage,
                    min: 9.5,
                    action: command(:disarm)}
      end

  One of `min` and `max` at least is required. A message without the field, or with `nil` in it,
  never counts. It is a `BB.Controller.PatternMatch` whose condition is the bounds.

  ## Options

  #{BB.Options.docs(@options)}
  """

  use BB.Controller, options_schema: @options.schema

  alias BB.Controller.PatternMatch
  alias BB.Message

  @impl BB.Controller
  def init(opts), do: opts |> put_match() |> PatternMatch.init()

  @impl BB.Controller
  def handle_options(opts, state), do: opts |> put_match() |> PatternMatch.handle_options(state)

  @impl BB.Controller
  defdelegate handle_info(message, state), to: PatternMatch

  defp put_match(opts) do
    {min, max, way} = {opts[:min], opts[:max], List.wrap(opts[:field])}

    if min == nil and max == nil do
      raise ArgumentError,
            "expected the option :min or :max of BB.Controller.Threshold, got neither; " <>
              "give at least one bound"
    end

    Keyword.put(opts, :match, fn %Message{payload: payload} ->
      outside?(fetch(payload, way), min, max)
    end)
  end

  defp outside?(value, min, max) when is_number(value),
    do: (min != nil and value < min) or (max != nil and value > max)

  defp outside?(_absent, _min, _max), do: false

  # Payloads are structs, which do not have the Access behaviour.
  defp fetch(value, []), do: value
  defp fetch(%{} = map, [key | way]), do: map |> Map.get(key) |> fetch(way)

  defp fetch([{_, _} | _] = keywords, [key | way]) when is_atom(key),
    do: keywords |> Keyword.get(key) |> fetch(way)

  defp fetch(_other, _way), do: nil
end
