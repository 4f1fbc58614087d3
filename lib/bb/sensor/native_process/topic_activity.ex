defmodule BB.Sensor.NativeProcess.TopicActivity do
  @moduledoc """
  Whether a native process has published on its ring topics since the last check.

  `BB.Sensor.NativeProcess` checks it for a sensor with a `max_silence`.

  Which of its topics a program publishes, and which it reads, is either declared (`publishes:`)
  or found in the topic itself: its writer is the program, or a process that the program has
  started. A writer without a process number, such as a publisher without our extension, counts as
  the program.
  """
  @moduledoc no_example: "internal: BB.Sensor.NativeProcess checks its topics"

  alias BB.Ring

  @enforce_keys [:topics, :publishes]
  defstruct [:topics, :publishes, counts: %{}, own_pids: %{}]

  @typedoc "The topics, and whether the program publishes `:all` of them or those that it writes."
  @type t :: %__MODULE__{
          topics: [String.t()],
          publishes: :all | :by_writer,
          counts: %{String.t() => non_neg_integer()},
          own_pids: %{pos_integer() => boolean()}
        }

  @typedoc """
  The result of a check: the publisher, and whether it has published since the last check.

  The publisher is `:others` when each topic has a living writer that is another process. The
  program then publishes on none of its topics.
  """
  @type result :: {:program | :others, boolean()}

  @doc "Returns the activity of topics that were not checked yet."
  @spec new([String.t()], :all | :by_writer) :: t()
  def new(topics, publishes), do: %__MODULE__{topics: topics, publishes: publishes}

  @doc """
  Checks the topics.

  `os_pid` is the program or a process above it. The first check finds no message.
  """
  @spec check(t(), non_neg_integer()) :: {result(), t()}
  def check(activity, os_pid) do
    {results, activity} = Enum.map_reduce(activity.topics, activity, &check_topic(&2, &1, os_pid))

    {combine(results), activity}
  end

  defp combine(results) do
    publisher = if Enum.all?(results, &match?({:others, _}, &1)), do: :others, else: :program
    {publisher, Enum.any?(results, &(&1 == {publisher, true}))}
  end

  defp check_topic(activity, topic, os_pid) do
    case Ring.info(topic) do
      {:ok, %{published: count} = info} ->
        {writer, activity} = find_writer(activity, info, os_pid)
        published? = count != Map.get(activity.counts, topic, count)
        {{writer, published?}, put_count(activity, topic, count)}

      # The topic does not exist yet, or is being replaced. All its messages will be new.
      {:error, _reason} ->
        {{:none, false}, put_count(activity, topic, 0)}
    end
  end

  defp put_count(activity, topic, count),
    do: %{activity | counts: Map.put(activity.counts, topic, count)}

  defp find_writer(%{publishes: :all} = activity, _info, _os_pid), do: {:program, activity}
  defp find_writer(activity, %{writer_pid: 0}, _os_pid), do: {:program, activity}

  defp find_writer(activity, %{writer_pid: pid, state: state}, os_pid) do
    own? = Map.get_lazy(activity.own_pids, pid, fn -> descendant?(pid, os_pid) end)
    activity = %{activity | own_pids: Map.put(activity.own_pids, pid, own?)}

    cond do
      own? -> {:program, activity}
      state == :live -> {:others, activity}
      true -> {:none, activity}
    end
  end

  defp descendant?(os_pid, os_pid), do: true
  defp descendant?(pid, _os_pid) when pid <= 1, do: false

  defp descendant?(pid, os_pid) do
    case fetch_parent(pid) do
      {:ok, parent} -> descendant?(parent, os_pid)
      :error -> false
    end
  end

  # The command's name is in parentheses, and may contain any character.
  defp fetch_parent(pid) do
    with {:ok, stat} <- File.read("/proc/#{pid}/stat"),
         [_state, parent | _] <- stat |> String.split(") ") |> List.last() |> String.split(" "),
         do: {:ok, String.to_integer(parent)},
         else: (_ -> :error)
  end
end
