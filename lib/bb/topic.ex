defmodule BB.Topic do
  @moduledoc """
  The names of ring topics in a robot, with the robot's topic prefix.

  Give a robot a topic prefix when several robots run on one machine. Otherwise those that declare
  the same topic use the same shared memory:

      settings do
        topic_prefix "rover"
      end

      sensors do
        sensor :imu_outlet, {BB.Handoff.Outlet, topic: "imu", …}      # the ring topic rover.imu
        sensor :seen, {BB.Handoff.Inlet, topic: "/tags", …}           # the ring topic tags
      end

  The topic prefix is put before every topic that the robot's components name: `topic:` of outlets
  and inlets, `topics:` and `publishes:` of native processes.
  `MyRobot.start_link(topic_prefix: "second")` overrides that of the settings. Without either,
  topics have the declared names. A name that begins with `/` is absolute, as in ROS: the
  ring topic is the name without the `/`, whatever the topic prefix.

      iex> BB.Topic.resolve("imu", "rover")
      {:ok, "rover.imu"}
      iex> BB.Topic.resolve("/tags", "rover")
      {:ok, "tags"}
      iex> BB.Topic.resolve("imu", nil)
      {:ok, "imu"}

  `BB.topic/2` returns the ring topic of a name in a robot.
  """

  # The file of a topic is named "conduit_" and the topic's name, at most 255 bytes together.
  @longest 200
  @longest_found 247

  @typedoc "A name as declared: relative to the robot's prefix, or absolute with a leading `/`."
  @type name :: String.t()

  @doc """
  Returns the ring topic of a declared name under a prefix, or `{:error, message}`.

  Without a prefix, the name is not checked: topics of other programs may have names that a
  robot's own may not.
  """
  @spec resolve(name(), String.t() | nil) :: {:ok, String.t()} | {:error, String.t()}
  def resolve("/" <> topic, _prefix), do: check_found(topic)
  def resolve(name, nil), do: {:ok, name}

  def resolve(name, prefix) do
    with {:error, message} <- check(prefix <> "." <> name),
         do:
           {:error,
            "#{message}, with the robot's topic_prefix before it; choose a shorter or another " <>
              "name, or put a / before it if it is not the robot's own topic"}
  end

  @doc "Returns the ring topic of a declared name in a robot, or `{:error, message}`."
  @spec of(module(), name()) :: {:ok, String.t()} | {:error, String.t()}
  def of(robot, name), do: resolve(name, prefix(robot))

  @doc "Returns the topic prefix that the robot was started with, that of its settings, or `nil`."
  @spec prefix(module()) :: String.t() | nil
  def prefix(robot) do
    with nil <- :persistent_term.get({__MODULE__, robot}, nil), do: settings_prefix(robot)
  end

  # The robot of a driver's test may have no settings.
  defp settings_prefix(robot) do
    if Code.ensure_loaded?(robot) and function_exported?(robot, :robot, 0),
      do: robot.robot().settings[:topic_prefix]
  end

  @doc "Sets the robot's topic prefix. With `nil`, the robot uses that of its settings."
  @spec put_prefix(module(), String.t() | nil) :: :ok
  def put_prefix(robot, nil) do
    _ = :persistent_term.erase({__MODULE__, robot})
    :ok
  end

  def put_prefix(robot, prefix), do: :persistent_term.put({__MODULE__, robot}, prefix)

  @doc """
  Checks the name of a topic that a robot creates: one that programs in every language accept.
  """
  @spec check(term()) :: {:ok, String.t()} | {:error, String.t()}
  def check(topic) do
    if is_binary(topic) and topic =~ ~r/\A[A-Za-z0-9_.-]{1,#{@longest}}\z/,
      do: {:ok, topic},
      else:
        {:error,
         "expected a topic's name of 1 to #{@longest} characters out of A-Z a-z 0-9 _ . -, " <>
           "got: #{inspect(topic)}"}
  end

  @doc "Checks the name of an existing topic, which a program with other rules may have created."
  @spec check_found(term()) :: {:ok, String.t()} | {:error, String.t()}
  def check_found(topic) do
    if is_binary(topic) and String.valid?(topic) and byte_size(topic) <= @longest_found and
         topic =~ ~r/\A[^\/[:cntrl:]]+\z/u,
       do: {:ok, topic},
       else:
         {:error,
          "expected a topic's name: 1 to #{@longest_found} bytes of text without / and " <>
            "control characters, got: #{inspect(topic)}"}
  end

  @doc false
  def check_prefix(prefix) do
    with {:error, _message} <- check(prefix) do
      {:error,
       "expected text such as \"rover\", 1 to #{@longest} characters out of " <>
         "A-Z a-z 0-9 _ . -, got: #{inspect(prefix)}"}
    end
  end

  # The names in options, with or without the / of an absolute name.

  @doc false
  def check_declared(name), do: check_with(name, &check/1)

  @doc false
  def check_declared_found(name), do: check_with(name, &check_found/1)

  defp check_with("/" <> topic = name, check),
    do: with({:ok, _topic} <- check.(topic), do: {:ok, name})

  defp check_with(name, check), do: check.(name)
end
