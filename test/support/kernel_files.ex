defmodule BB.Test.KernelFiles do
  @moduledoc "Replaces files of the kernel in a folder that stands for the root."

  @doc "Writes a file atomically, as the kernel's files are read."
  def put(root, file, text) do
    path = Path.join(root, file)
    File.mkdir_p!(Path.dirname(path))
    File.write!(path <> ".new", text)
    File.rename!(path <> ".new", path)
  end
end
