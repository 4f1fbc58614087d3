defmodule BB.Test.Run do
  @moduledoc """
  Unique names for one run of the tests: for ring topics, temporary files and nodes.

  `bin/test` sets the name of the run in `GANGLION_RUN`, uses it to find what the run has left
  behind, and removes that.
  """

  @doc """
  Makes this VM a run, or a part of the run that has started it.

  The run's name is in the environment of its children, and temporary files go into a folder that
  is removed after the tests.
  """
  def begin do
    folder = Path.join(System.tmp_dir!(), unique("tmp"))
    File.mkdir_p!(folder)
    System.put_env("GANGLION_RUN", name())
    System.put_env("TMPDIR", folder)
    ExUnit.after_suite(fn _result -> File.rm_rf!(folder) end)
  end

  @doc "Returns the run's name."
  def name, do: System.get_env("GANGLION_RUN") || "run#{System.pid()}"

  @doc "Returns a name that no other test has, in any run, for a topic, a file or a node."
  def unique(label \\ "t"),
    do: "#{name()}.#{System.pid()}.#{System.unique_integer([:positive])}.#{label}"
end
