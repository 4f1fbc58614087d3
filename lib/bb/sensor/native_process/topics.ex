defmodule BB.Sensor.NativeProcess.Topics do
  @moduledoc """
  The options `topics:` and `publishes:` of a native process: the ring topics that its program
  works with, and those of them that it publishes.

  `BB.Sensor.NativeProcess` reads the options by these functions. The module is pure.

      iex> opts = [topics: [frames: "camera", detections: "tags"], publishes: [:detections]]
      iex> BB.Sensor.NativeProcess.Topics.names(opts)
      ["camera", "tags"]
      iex> {:ok, resolved} = BB.Sensor.NativeProcess.Topics.resolve(opts, MyRobot)
      iex> BB.Sensor.NativeProcess.Topics.published(resolved)
      {:ok, ["tags"], :all}
  """

  @doc "Returns the names of ring topics in the declared options."
  @spec names(keyword()) :: [BB.Topic.name()]
  def names(opts) do
    for names <- [opts[:topics], opts[:publishes]], is_list(names), entry <- names do
      with {_key, name} <- entry, do: name
    end
    |> Enum.filter(&is_binary/1)
  end

  @doc "Puts the robot's topic prefix before the names of both options."
  @spec resolve(keyword(), module()) :: {:ok, keyword()} | {:error, {:topic, String.t()}}
  def resolve(opts, robot) do
    with {:ok, topics} <- resolve_all(opts[:topics], robot),
         {:ok, publishes} <- resolve_all(opts[:publishes] || [], robot) do
      {:ok, Keyword.merge(opts, topics: topics, publishes: if(opts[:publishes], do: publishes))}
    end
  end

  defp resolve_all(entries, robot) do
    Enum.reduce_while(entries, {:ok, []}, fn entry, {:ok, resolved} ->
      case resolve_entry(entry, robot) do
        {:ok, entry} -> {:cont, {:ok, resolved ++ [entry]}}
        {:error, message} -> {:halt, {:error, {:topic, message}}}
      end
    end)
  end

  defp resolve_entry({key, name}, robot) do
    with {:ok, topic} <- resolve_entry(name, robot), do: {:ok, {key, topic}}
  end

  defp resolve_entry(name, robot) when is_binary(name), do: BB.Topic.of(robot, name)
  # An entry of `publishes` may be a key of `topics`.
  defp resolve_entry(key, _robot), do: {:ok, key}

  @doc """
  Returns the ring topics by which `max_silence` is measured.

  With `publishes:` the program publishes `:all` of them; without, those whose writer it is.
  """
  @spec published(keyword()) ::
          {:ok, [String.t()], :all | :by_writer} | {:error, {:no_topic, term()}}
  def published(opts) do
    topics = opts[:topics]

    case opts[:publishes] do
      nil ->
        {:ok, topics |> Keyword.values() |> Enum.filter(&topic?/1), :by_writer}

      keys ->
        names = for key <- keys, do: {key, if(is_atom(key), do: topics[key], else: key)}

        case Enum.find(names, fn {_key, name} -> not topic?(name) end) do
          nil -> {:ok, Enum.map(names, &elem(&1, 1)), :all}
          {key, _name} -> {:error, {:no_topic, key}}
        end
    end
  end

  # A program may take an option of `topics` that is no topic's name.
  defp topic?(name), do: match?({:ok, _name}, BB.Ring.check_found_topic(name))

  @doc """
  Checks that `max_silence` can be measured with the declared options.

  Options that are references to parameters, or wrong, pass: they are checked when the robot
  starts.
  """
  @spec check_max_silence(keyword()) :: :ok | {:error, String.t()}
  def check_max_silence(opts) do
    topics = Keyword.get(opts, :topics, [])
    publishes = opts[:publishes]

    cond do
      not (Keyword.keyword?(topics) and (is_nil(publishes) or is_list(publishes))) ->
        :ok

      publishes == [] or (publishes == nil and topics == []) ->
        {:error, no_published_topic()}

      key = Enum.find(publishes || [], &unknown?(&1, topics)) ->
        {:error, unknown_key(key, topics)}

      true ->
        :ok
    end
  end

  defp no_published_topic do
    """
    cannot measure max_silence with no ring topic; name the topics that the program publishes in \
    `topics:` or `publishes:`, or remove max_silence\
    """
  end

  defp unknown_key(key, topics) do
    """
    invalid value for :publishes option: expected keys of `topics:` or names of ring topics, \
    got: #{inspect(key)}; the keys of `topics:` are #{inspect(Keyword.keys(topics))}\
    """
  end

  defp unknown?(key, topics), do: is_atom(key) and not Keyword.has_key?(topics, key)
end
