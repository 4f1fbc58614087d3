defmodule BB.Dsl.Controllers do
  @moduledoc "The word inside `controllers`."

  import BB.Dsl.Vocabulary, only: [entity: 5]

  @inside [BB.Dsl.Controller]

  @doc """
  Declares a controller: `controller :balance, {MyRobot.Balance, gain: param([:balance, :gain])}`.

  Field: `required` - whether the robot is of no use without it (`false`).
  """
  defmacro controller(name, child), do: entity(:controller, [name, child], 2, @inside, __CALLER__)

  defmacro controller(name, child, fields),
    do: entity(:controller, [name, child, fields], 2, @inside, __CALLER__)

  defmacro controller(name, child, fields, block),
    do: entity(:controller, [name, child, fields, block], 2, @inside, __CALLER__)
end
