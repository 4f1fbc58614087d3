defmodule BB.Dsl.Error do
  @moduledoc """
  A mistake in a robot's declaration, raised while the robot's module compiles.

    * `:module` - the robot
    * `:path` - the place in the declaration: sections, entities by their names, `[:topology, :base_link, :shoulder]`
    * `:file`, `:line` - the place in the source
    * `:reason` - what is wrong and what to do about it
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

  @doc "`file:line`, the file relative to the current directory."
  @spec place(%{:file => String.t(), :line => non_neg_integer(), optional(atom()) => term()}) ::
          String.t()
  def place(%{file: file, line: line}), do: "#{Path.relative_to_cwd(file)}:#{line}"
end
