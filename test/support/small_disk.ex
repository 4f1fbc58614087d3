defmodule BB.Test.SmallDisk do
  @moduledoc """
  A file system of a few KiB in memory for one test, which can be full or read-only.

  Only root may mount one. For other users `mount/1` prints a message and returns `:error`, and
  the test has to work without it.
  """

  import ExUnit.Callbacks, only: [on_exit: 1]

  @doc "Mounts a file system until the end of the test: `{:ok, folder}`."
  def mount(kibibytes) do
    folder = Path.join(System.tmp_dir!(), "small_disk_#{System.os_time()}_#{:rand.uniform(9999)}")
    File.mkdir_p!(folder)
    on_exit(fn -> unmount(folder) end)
    options = ~w(-t tmpfs -o size=#{kibibytes}k none #{folder})

    case run("mount", options) do
      {_, 0} ->
        {:ok, folder}

      {said, _} ->
        IO.puts("no file system of #{kibibytes} KiB can be mounted here: #{String.trim(said)}")
        :error
    end
  end

  @doc "Fills the free space."
  def fill(folder) do
    {:error, :enospc} = File.write(Path.join(folder, "filler"), :binary.copy("x", 16_777_216))
    :ok
  end

  @doc "Frees space again."
  def free(folder), do: File.rm!(Path.join(folder, "filler"))

  @doc "Makes it read-only (`\"ro\"`) or writable (`\"rw\"`)."
  def remount(folder, how) do
    {_, 0} = run("mount", ["-o", "remount,#{how}", folder])
    :ok
  end

  defp unmount(folder) do
    _ = run("umount", [folder])
    File.rmdir(folder)
  end

  defp run(command, arguments) do
    System.cmd(command, arguments, stderr_to_stdout: true)
  rescue
    error in ErlangError -> {inspect(error.original), 1}
  end
end
