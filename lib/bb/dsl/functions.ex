defmodule BB.Dsl.Functions do
  @moduledoc """
  Makes functions of a robot's module out of the anonymous functions in a component's options,
  which cannot be part of a compiled module. Words that take a child use it.

      controller :low, {BB.Controller.PatternMatch,
        topic: [:sensor, :battery],
        match: fn message -> message.payload.voltage < 10.5 end,
        action: handle_event(&BB.publish(&2.robot_module, [:low], &1))}

  Such a function sees no variables of the code around it. A capture of a remote function,
  `&Module.function/1`, remains as it is.
  """

  @counter :bb_functions
  @prefix "__bb_function_"

  @doc """
  Returns the code of a word's arguments with their anonymous functions replaced, and the
  definitions that take their place. A function that the arguments call themselves, as in
  `Enum.map(1..3, fn …)`, remains as it is.
  """
  @spec lift([Macro.t()], Macro.Env.t()) :: {[Macro.t()], [Macro.t()]}
  def lift(arguments, caller), do: replace(arguments, [], caller)

  @doc "Returns whether a function is one that `lift/2` has defined."
  @spec lifted?(function()) :: boolean()
  def lifted?(function) do
    name = function |> Function.info() |> Keyword.fetch!(:name) |> Atom.to_string()
    String.starts_with?(name, @prefix)
  end

  defp replace(list, definitions, caller) when is_list(list),
    do: Enum.map_reduce(list, definitions, &replace(&1, &2, caller))

  defp replace({key, value}, definitions, caller) do
    {value, definitions} = replace(value, definitions, caller)
    {{key, value}, definitions}
  end

  defp replace({:handle_event, meta, [handler]}, definitions, caller) do
    {handler, definitions} = replace(handler, definitions, caller)
    {{:handle_event, meta, [handler]}, definitions}
  end

  defp replace(ast, definitions, caller) do
    case arity(ast) do
      nil ->
        {ast, definitions}

      arity ->
        name = :"#{@prefix}#{count(caller.module)}__"
        capture = quote(do: Function.capture(__MODULE__, unquote(name), unquote(arity)))
        {capture, [definition(name, arity, ast) | definitions]}
    end
  end

  defp definition(name, arity, ast) do
    arguments = Macro.generate_arguments(arity, __MODULE__)

    quote generated: true do
      unless Module.defines?(__MODULE__, {unquote(name), unquote(arity)}) do
        @doc false
        def unquote(name)(unquote_splicing(arguments)),
          do: unquote(ast).(unquote_splicing(arguments))
      end
    end
  end

  defp arity({:fn, _, [{:->, _, [[{:when, _, arguments}], _]} | _]}), do: length(arguments) - 1
  defp arity({:fn, _, [{:->, _, [arguments, _]} | _]}), do: length(arguments)
  defp arity({:&, _, [{:/, _, [{{:., _, _}, _, []}, _]}]}), do: nil
  defp arity({:&, _, [{:/, _, [{_name, _, _}, arity]}]}) when is_integer(arity), do: arity
  defp arity({:&, _, [position]}) when is_integer(position), do: nil
  defp arity({:&, _, [body]}), do: highest_position(body)
  defp arity(_ast), do: nil

  defp highest_position(body) do
    {_body, highest} =
      Macro.prewalk(body, 0, fn
        {:&, _, [n]} = ast, highest when is_integer(n) -> {ast, max(n, highest)}
        ast, highest -> {ast, highest}
      end)

    highest
  end

  defp count(module) do
    count = Module.get_attribute(module, @counter) || 0
    Module.put_attribute(module, @counter, count + 1)
    count
  end
end
