defmodule BB.Test.Mistake do
  @moduledoc "Compiles robots with an invalid declaration."

  import ExUnit.Assertions

  @doc """
  Compiles a robot with the given lines, the first of which is line 3, and returns the error.
  """
  def mistake(lines) do
    name = "Mistaken#{System.unique_integer([:positive])}"
    source = "defmodule #{name} do\n  use BB\n#{lines}\nend"
    error = assert_raise BB.Dsl.Error, fn -> Code.compile_string(source, "lib/robot.ex") end
    assert inspect(error.module) == name
    message = Exception.message(error)
    assert message =~ "#{name}#{place(error.path)} (lib/robot.ex:#{error.line}): "
    error
  end

  defp place([]), do: ""
  defp place(path), do: ", " <> Enum.map_join(path, " -> ", &name/1)

  defp name(name), do: name |> inspect() |> String.trim_leading(":")
end
