defmodule BB.Dsl.Robot do
  @moduledoc "The sections of a robot: the words that `use BB` imports."

  import BB.Dsl.Vocabulary, only: [entity: 5]

  # What values are made of: ~u and param/1.
  @values [BB.Unit, BB.Parameter.Reference]

  @doc """
  What holds for the robot as a whole.

    * `name` - what people call it, an atom
    * `parameter_store` - where parameters are kept, `{BB.Parameter.Store.Log, path: "/data/params"}`
    * `registry_module` - a module with the functions of `Registry` for the robot's process registry (`Registry`)
    * `registry_options` - options for its start beside `keys:` and `name:`, such as `[partitions: 2]`
    * `supervisor_module` - a module with `Supervisor.start_link/3` for the robot's supervisors (`Supervisor`)
  """
  defmacro settings(fields), do: entity(:settings, [fields], 0, [BB.Dsl.Settings], __CALLER__)

  @doc "The sensors that belong to the robot as a whole and to no link: its battery, its processor."
  defmacro sensors(block),
    do: entity(:sensors, [block], 0, @values ++ [BB.Dsl.Component], __CALLER__)

  @doc "What of the robot can be tuned while it runs: `param` and `group`. See `BB.Parameter`."
  defmacro parameters(block),
    do: entity(:parameters, [block], 0, [BB.Unit, BB.Dsl.Parameters], __CALLER__)

  @doc "The controllers, which belong to the robot as a whole: `controller`."
  defmacro controllers(block),
    do: entity(:controllers, [block], 0, @values ++ [BB.Dsl.Component], __CALLER__)

  @doc "The robot's links and joints, a tree with one root link, and the sensors on them."
  defmacro topology(block),
    do: entity(:topology, [block], 0, @values ++ [BB.Dsl.Topology], __CALLER__)
end
