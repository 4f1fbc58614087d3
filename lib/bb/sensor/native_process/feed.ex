defmodule BB.Sensor.NativeProcess.Feed do
  @moduledoc """
  The ring topics of a native process, looked at from time to time: has it published meanwhile?

  Which of its topics a program publishes, and which it reads, is either declared or told by the
  topic itself: its writer is the program, or a process that the program has started. A writer
  that leaves no number, as one without our extension, counts as the program.
  """

  alias BB.Ring

  @enforce_keys [:topics, :published]
  defstruct [:topics, :published, counts: %{}, ours: %{}]

  @typedoc "The topics; whether all of them are published by the program, or `:by_writer`."
  @type t :: %__MODULE__{
          topics: [String.t()],
          published: :all | :by_writer,
          counts: %{String.t() => non_neg_integer()},
          ours: %{pos_integer() => boolean()}
        }

  @typedoc """
  What a look shows: whether the program has published since the last one. Where each of its topics
  has a living writer that is another process, it publishes nothing that could be seen: then,
  whether the others have.
  """
  @type shown :: {:program | :others, boolean()}

  @doc "Of these topics, which are not looked at yet."
  @spec new([String.t()], :all | :by_writer) :: t()
  def new(topics, published), do: %__MODULE__{topics: topics, published: published}

  @doc "Looks at them. `os_pid` is the program or a process above it. The first look shows nothing."
  @spec look(t(), non_neg_integer()) :: {shown(), t()}
  def look(feed, os_pid) do
    {topics, feed} = Enum.map_reduce(feed.topics, feed, &look_at(&2, &1, os_pid))
    {show(topics), feed}
  end

  defp show(topics) do
    writer = if Enum.all?(topics, &match?({:others, _}, &1)), do: :others, else: :program
    {writer, Enum.any?(topics, &(&1 == {writer, true}))}
  end

  defp look_at(feed, topic, os_pid) do
    case Ring.info(topic) do
      {:ok, %{published: count} = info} ->
        {writer, feed} = writer(feed, info, os_pid)
        more? = count != Map.get(feed.counts, topic, count)
        {{writer, more?}, %{feed | counts: Map.put(feed.counts, topic, count)}}

      # It is not there yet, or is being made anew: what comes then is new.
      {:error, _reason} ->
        {{:none, false}, %{feed | counts: Map.put(feed.counts, topic, 0)}}
    end
  end

  defp writer(%{published: :all} = feed, _info, _os_pid), do: {:program, feed}
  defp writer(feed, %{writer_pid: 0}, _os_pid), do: {:program, feed}

  defp writer(feed, %{writer_pid: pid, state: state}, os_pid) do
    ours? = Map.get_lazy(feed.ours, pid, fn -> below?(pid, os_pid) end)
    feed = %{feed | ours: Map.put(feed.ours, pid, ours?)}

    cond do
      ours? -> {:program, feed}
      state == :live -> {:others, feed}
      true -> {:none, feed}
    end
  end

  defp below?(os_pid, os_pid), do: true
  defp below?(pid, _os_pid) when pid <= 1, do: false

  defp below?(pid, os_pid) do
    case parent(pid) do
      {:ok, parent} -> below?(parent, os_pid)
      :error -> false
    end
  end

  # The command's name stands in parentheses and may hold anything.
  defp parent(pid) do
    with {:ok, stat} <- File.read("/proc/#{pid}/stat"),
         [_state, parent | _] <- stat |> String.split(") ") |> List.last() |> String.split(" "),
         do: {:ok, String.to_integer(parent)},
         else: (_ -> :error)
  end
end
