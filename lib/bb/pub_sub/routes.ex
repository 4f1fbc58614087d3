defmodule BB.PubSub.Routes do
  @few 8

  @moduledoc """
  The routes of a pubsub: for each stream, the processes that get its messages. All functions are
  pure.

  `BB.PubSub.Registrar` makes routes when subscriptions change, and publishers look theirs up:

      Routes.find(routes, [:sensor, :base_link, :imu], BB.Message.Sensor.Imu)

  A lookup touches little memory. The last segment of a path distinguishes most paths; it is the
  key of a map whose values are the few routes of paths that end in it. More than #{@few} such
  routes become a map of their own.
  """

  alias BB.Path
  alias BB.PubSub.{Admission, Meter, Replay}

  @type t :: %{(Path.segment() | nil) => [route()] | %{{Path.t(), module()} => route()}}

  @typedoc """
  A stream's path and payload type, its meter, its targets, the version of the route, and the
  sequence of a retained path.

  Publishers may use the route while its version is that of the meter.
  """
  @type route ::
          {Path.t(), module(), Meter.t(), [target()], version :: non_neg_integer(),
           Replay.sequence() | nil}

  @typedoc "A process that gets every message, or one with the admissions of its subscriptions."
  @type target :: pid() | {pid(), [Admission.t()]}

  @doc "Returns a table without routes."
  @spec new() :: t()
  def new, do: %{}

  @doc "Returns the route of a stream, or `nil`. An invalid path has none."
  @spec find(t(), Path.t(), module()) :: route() | nil
  def find(routes, path, type) do
    last = last(path)

    case routes do
      %{^last => few} when is_list(few) -> find_in(few, path, type)
      %{^last => %{{^path, ^type} => route}} -> route
      _ -> nil
    end
  end

  defp last([segment]), do: segment
  defp last([_ | rest]), do: last(rest)
  defp last(_), do: nil

  defp find_in([{path, type, _, _, _, _} = route | _], path, type), do: route
  defp find_in([_ | rest], path, type), do: find_in(rest, path, type)
  defp find_in([], _path, _type), do: nil

  @doc "Puts a route in the place of its stream's former one."
  @spec put(t(), route()) :: t()
  def put(routes, route) do
    last = last(elem(route, 0))
    Map.put(routes, last, routes |> Map.get(last, []) |> put_in_few(route))
  end

  defp put_in_few(many, route) when is_map(many), do: Map.put(many, stream(route), route)

  defp put_in_few(few, route) do
    stream = stream(route)
    few = [route | Enum.reject(few, &(stream(&1) == stream))]
    if length(few) > @few, do: Map.new(few, &{stream(&1), &1}), else: few
  end

  defp stream({path, type, _, _, _, _}), do: {path, type}

  @doc "Deletes the route of a stream, if there is one."
  @spec delete(t(), {Path.t(), module()}) :: t()
  def delete(routes, {path, _type} = stream) do
    last = last(path)

    case delete_from(Map.get(routes, last, []), stream) do
      [] -> Map.delete(routes, last)
      left -> Map.put(routes, last, left)
    end
  end

  defp delete_from(many, stream) when is_map(many), do: Map.delete(many, stream)
  defp delete_from(few, stream), do: Enum.reject(few, &(stream(&1) == stream))
end
