defmodule BB.Topic do
  @moduledoc """
  Names of ring topics, and what a robot makes of them.

  Two robots on one machine would meet in shared memory under the names that both of them declare.
  A robot with a prefix has topics of its own:

      settings do
        topic_prefix "rover"
      end

      sensors do
        sensor :imu_outlet, {BB.Handoff.Outlet, topic: "imu", …}      # the ring topic rover.imu
        sensor :seen, {BB.Handoff.Inlet, topic: "/tags", …}           # the ring topic tags
      end

  The prefix goes before every topic that the robot's components name, `topic:` of outlets and
  inlets, `topics:` and `publishes:` of native processes. `MyRobot.start_link(topic_prefix: "second")`
  goes before the one of the settings; without either, names are as they are declared. A name that
  begins with `/` is absolute, as in ROS: it is the ring topic without the `/`, whatever the prefix.

      iex> BB.Topic.resolve("imu", "rover")
      {:ok, "rover.imu"}
      iex> BB.Topic.resolve("/tags", "rover")
      {:ok, "tags"}
      iex> BB.Topic.resolve("imu", nil)
      {:ok, "imu"}

  `BB.topic/2` gives the ring topic of a name in a robot.
  """

  # "conduit_" and the name are a file's name, of at most 255 bytes.
  @longest 200
  @longest_found 247

  @typedoc "A name as declared: relative to the robot's prefix, or absolute with a `/` before it."
  @type name :: String.t()

  @doc """
  The ring topic of a declared name under a prefix, or a sentence that says why it is none. A name
  without a prefix is taken as it is: others' topics may have names that ours may not.
  """
  @spec resolve(name(), String.t() | nil) :: {:ok, String.t()} | {:error, String.t()}
  def resolve("/" <> topic, _prefix), do: check_found(topic)
  def resolve(name, nil), do: {:ok, name}

  def resolve(name, prefix) do
    with {:error, why} <- check(prefix <> "." <> name),
         do:
           {:error,
            "#{why}, with the robot's topic_prefix before it; give it a shorter or another name, " <>
              "or, if it is not the robot's own topic, a / before it"}
  end

  @doc "The ring topic of a declared name in a robot."
  @spec of(module(), name()) :: {:ok, String.t()} | {:error, String.t()}
  def of(robot, name), do: resolve(name, prefix(robot))

  @doc "The robot's prefix: the one it was started with, or that of its settings; `nil` for none."
  @spec prefix(module()) :: String.t() | nil
  def prefix(robot) do
    with nil <- :persistent_term.get({__MODULE__, robot}, nil), do: declared(robot)
  end

  # A driver's test need not have a robot.
  defp declared(robot) do
    if Code.ensure_loaded?(robot) and function_exported?(robot, :robot, 0),
      do: robot.robot().settings[:topic_prefix]
  end

  @doc "From now on it is the robot's prefix; `nil` for that of its settings."
  @spec put_prefix(module(), String.t() | nil) :: :ok
  def put_prefix(robot, nil) do
    _ = :persistent_term.erase({__MODULE__, robot})
    :ok
  end

  def put_prefix(robot, prefix), do: :persistent_term.put({__MODULE__, robot}, prefix)

  @doc "A topic's name as it is made: read by each language's programs and tools."
  @spec check(term()) :: {:ok, String.t()} | {:error, String.t()}
  def check(topic) do
    if is_binary(topic) and topic =~ ~r/\A[A-Za-z0-9_.-]{1,#{@longest}}\z/,
      do: {:ok, topic},
      else:
        {:error,
         "a topic's name is 1 to #{@longest} characters out of A-Z a-z 0-9 _ . -, " <>
           "got: #{inspect(topic)}"}
  end

  @doc "A topic's name as it is found: a publisher of other rules may have made it."
  @spec check_found(term()) :: {:ok, String.t()} | {:error, String.t()}
  def check_found(topic) do
    if is_binary(topic) and String.valid?(topic) and byte_size(topic) <= @longest_found and
         topic =~ ~r/\A[^\/[:cntrl:]]+\z/u,
       do: {:ok, topic},
       else:
         {:error,
          "expected a topic's name: 1 to #{@longest_found} bytes of text without / and control " <>
            "characters, got: #{inspect(topic)}"}
  end

  @doc false
  def check_prefix(prefix) do
    with {:error, _why} <- check(prefix) do
      {:error,
       "expected text such as \"rover\", 1 to #{@longest} characters out of A-Z a-z 0-9 _ . -, " <>
         "got: #{inspect(prefix)}"}
    end
  end

  # The names of options, with or without the / of an absolute one.

  @doc false
  def check_declared(name), do: declared(name, &check/1)

  @doc false
  def check_declared_found(name), do: declared(name, &check_found/1)

  defp declared("/" <> topic = name, check),
    do: with({:ok, _topic} <- check.(topic), do: {:ok, name})

  defp declared(name, check), do: check.(name)
end
