defmodule BB.Test.Linux do
  @moduledoc "A temporary folder that replaces /dev, and files for it."

  import ExUnit.Assertions
  import ExUnit.Callbacks

  @doc "A setup that configures `BB.Bus.Linux` with the test's folder."
  def use_folder(%{tmp_dir: folder}) do
    before = Application.fetch_env(:ganglion, BB.Bus.Linux)

    on_exit(fn ->
      case before do
        {:ok, options} -> Application.put_env(:ganglion, BB.Bus.Linux, options)
        :error -> Application.delete_env(:ganglion, BB.Bus.Linux)
      end
    end)

    configure(folder: folder)
  end

  @doc "Configures `BB.Bus.Linux`."
  def configure(options), do: Application.put_env(:ganglion, BB.Bus.Linux, options)

  @doc "Makes files with such names that are no devices: `[{name, kind}]`."
  def strangers(folder, prefix) do
    {_, 0} = System.cmd("mkfifo", [Path.join(folder, prefix <> "1")])
    File.write!(Path.join(folder, prefix <> "0"), "text")
    File.ln_s!("/dev/null", Path.join(folder, prefix <> "2"))
    File.ln_s!("/dev/ptmx", Path.join(folder, prefix <> "3"))

    [
      {prefix <> "0", :regular},
      {prefix <> "1", :fifo},
      {prefix <> "2", :null},
      {prefix <> "3", :pty}
    ]
  end

  @doc "Fails unless a module has the functions, each with its arities."
  def assert_functions(module, functions) do
    Code.ensure_loaded!(module)

    missing =
      for {name, arities} <- functions,
          arity <- arities,
          not function_exported?(module, name, arity),
          do: {name, arity}

    assert missing == []
  end

  @doc """
  Returns the result for a user without rights to open the file.

  If root runs the tests, the result is that of `code` in a VM of the user nobody.
  """
  def without_rights(path, fun, code) do
    File.chmod!(path, 0o000)
    if root?(), do: as_nobody(Path.dirname(path), code), else: fun.()
  end

  @doc "Gives a file to a group, if that is allowed."
  def chgrp(path, gid) do
    with :ok <- File.chgrp(path, gid), do: {:ok, gid}
  end

  @doc "Fails if the function leaves descriptors or threads behind."
  def assert_nothing_left(fun) do
    before = held()
    fun.()
    assert held() == before
  end

  defp held do
    # Listing the folders opens descriptors itself.
    for folder <- ~w(fd task), into: %{} do
      {folder, length(File.ls!("/proc/self/#{folder}"))}
    end
  end

  defp root?, do: match?({"0\n", 0}, System.cmd("id", ["-u"]))

  # The user nobody may not read all folders, so that the VM gets a copy.
  defp as_nobody(folder, code) do
    copy = Path.join(System.tmp_dir!(), "ganglion_nobody_#{System.unique_integer([:positive])}")
    File.mkdir_p!(Path.join(copy, "dev"))
    on_exit(fn -> File.rm_rf!(copy) end)
    File.cp_r!(Application.app_dir(:ganglion), Path.join(copy, "ganglion"))
    for name <- File.ls!(folder), do: locked(Path.join([copy, "dev", name]))
    {_, 0} = System.cmd("chmod", ["-R", "a+rX", copy])
    for name <- File.ls!(folder), do: File.chmod!(Path.join([copy, "dev", name]), 0)

    expression =
      "Application.put_env(:ganglion, BB.Bus.Linux, folder: #{inspect(Path.join(copy, "dev"))}); " <>
        "IO.write(inspect(#{code}))"

    argv =
      ~w(--reuid 65534 --regid 65534 --clear-groups elixir -pa) ++
        [Path.join([copy, "ganglion", "ebin"]), "-e", expression]

    {text, 0} = System.cmd("setpriv", argv, env: [{"HOME", copy}, {"ERL_LIBS", copy}], cd: copy)
    text |> Code.eval_string() |> elem(0)
  end

  defp locked(path), do: File.write!(path, "")
end
