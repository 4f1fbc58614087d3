defmodule BB.Test.Run do
  @moduledoc """
  What tells one run of the tests from another on the same machine: names for all that is the machine's, such as ring topics,
  files in the folder for temporary ones, and nodes.

  `bin/test` gives the run its name in `GANGLION_RUN`, finds by it what the run has left behind, and removes it.
  """

  @doc """
  Makes this VM a run, or part of the one that has started it: what it starts bears the run's name, and temporary files go into a
  folder that is removed after the tests.
  """
  def begin do
    folder = Path.join(System.tmp_dir!(), unique("tmp"))
    File.mkdir_p!(folder)
    System.put_env("GANGLION_RUN", name())
    System.put_env("TMPDIR", folder)
    ExUnit.after_suite(fn _result -> File.rm_rf!(folder) end)
  end

  @doc "The run's name."
  def name, do: System.get_env("GANGLION_RUN") || "run#{System.pid()}"

  @doc "A name that no other test has, in this run or another: good for a topic, a file or a node."
  def unique(label \\ "t"),
    do: "#{name()}.#{System.pid()}.#{System.unique_integer([:positive])}.#{label}"
end
