defmodule BB.Test.KernelFiles do
  @moduledoc "Files that a test puts in the place of the kernel's, in a folder that stands for the root."

  @doc "Puts a file there: whole or not at all, as the kernel's are."
  def put(root, file, text) do
    path = Path.join(root, file)
    File.mkdir_p!(Path.dirname(path))
    File.write!(path <> ".new", text)
    File.rename!(path <> ".new", path)
  end
end
