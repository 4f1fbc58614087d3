defmodule BB.Dsl.Robot do
  @moduledoc "The sections of a robot: the words that `use BB` imports."

  import BB.Dsl.Vocabulary, only: [entity: 5]

  @doc """
  What holds for the robot as a whole.

    * `name` - what people call it, an atom
  """
  defmacro settings(fields), do: entity(:settings, [fields], 0, [BB.Dsl.Settings], __CALLER__)

  @doc "The sensors that belong to the robot as a whole and to no link: its battery, its processor."
  defmacro sensors(block),
    do: entity(:sensors, [block], 0, [BB.Unit, BB.Dsl.Component], __CALLER__)

  @doc "The robot's links and joints, a tree with one root link, and the sensors on them."
  defmacro topology(block),
    do: entity(:topology, [block], 0, [BB.Unit, BB.Dsl.Topology], __CALLER__)
end
