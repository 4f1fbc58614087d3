defmodule BB.Dsl.Error do
  @moduledoc """
  A mistake in the declaration of a robot. The compiler raises it at the place of the mistake:

      ** (BB.Dsl.Error) MyRobot, topology -> base_link -> shoulder (lib/my_robot.ex:12): joint
      :shoulder has no type; add `type` with one of :revolute, :continuous, :prismatic, :fixed

  Its fields:

    * `:module` - the robot
    * `:path` - the place in the declaration: sections and the names of entities, such as
      `[:topology, :base_link, :shoulder]`
    * `:file`, `:line` - the place in the source
    * `:message` - the mistake and its remedy
    * `:reason` - the same text

  `exception/1` takes the text as either of the last two.
  """

  @type t :: %__MODULE__{
          module: module(),
          path: [BB.Dsl.Node.name()],
          file: String.t(),
          line: non_neg_integer(),
          message: String.t(),
          reason: String.t()
        }

  defexception [:module, :path, :file, :line, :message, :reason]

  @impl Exception
  def exception(fields) when is_list(fields) or is_map(fields) do
    error = struct!(__MODULE__, fields)
    text = error.message || error.reason
    %{error | message: text, reason: error.reason || text}
  end

  @impl Exception
  def message(%__MODULE__{} = error) do
    where = [inspect(error.module), path(error.path), source(error)]
    "#{Enum.join(where)}: #{error.message || error.reason}"
  end

  defp path(empty) when empty in [nil, []], do: ""
  defp path(names), do: ", " <> Enum.map_join(names, " -> ", &name/1)

  defp name(name) when is_atom(name), do: String.trim_leading(inspect(name), ":")
  defp name(name), do: inspect(name)

  defp source(%{file: nil}), do: ""
  defp source(%{line: nil, file: file}), do: " (#{Path.relative_to_cwd(file)})"
  defp source(error), do: " (#{place(error)})"

  @doc "Formats a place as `file:line`, with the file relative to the current directory."
  @spec place(%{:file => String.t(), :line => non_neg_integer(), optional(atom()) => term()}) ::
          String.t()
  def place(%{file: file, line: line}), do: "#{Path.relative_to_cwd(file)}:#{line}"
end
