defmodule BB.Dsl.Error do
  @moduledoc """
  A mistake in the declaration of a robot. The compiler raises it at the place of the mistake:

      ** (BB.Dsl.Error) MyRobot, [:topology, :base_link, :shoulder] (lib/my_robot.ex:12): joint
      :shoulder has no type; add `type` with one of :revolute, :continuous, :prismatic, :fixed

  Its fields:

    * `:module` - the robot
    * `:path` - the place in the declaration: sections and the names of entities, such as
      `[:topology, :base_link, :shoulder]`
    * `:file`, `:line` - the place in the source
    * `:reason` - the mistake and its remedy
  """

  @type t :: %__MODULE__{
          module: module(),
          path: [BB.Dsl.Node.name()],
          file: String.t(),
          line: non_neg_integer(),
          reason: String.t()
        }

  defexception [:module, :path, :file, :line, :reason]

  @impl Exception
  def message(%__MODULE__{} = error) do
    "#{inspect(error.module)}, #{inspect(error.path)} (#{place(error)}): #{error.reason}"
  end

  @doc "Formats a place as `file:line`, with the file relative to the current directory."
  @spec place(%{:file => String.t(), :line => non_neg_integer(), optional(atom()) => term()}) ::
          String.t()
  def place(%{file: file, line: line}), do: "#{Path.relative_to_cwd(file)}:#{line}"
end
