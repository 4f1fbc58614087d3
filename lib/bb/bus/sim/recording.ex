defmodule BB.Bus.Sim.Recording do
  @moduledoc """
  A recorded motion from a CSV file, for simulated inertial sensors.

  Load one to play it on a simulated chip (`BB.Bus.Sim.Mpu6050.Source`).

      iex> {:error, error} = BB.Bus.Sim.Recording.load("no_such_walk.csv")
      iex> Exception.message(error)
      "no_such_walk.csv: no such file or directory"

  The first line names the columns. The first seven must be

      Time (s), Gyroscope X (deg/s), Gyroscope Y (deg/s), Gyroscope Z (deg/s),
      Accelerometer X (g), Accelerometer Y (g), Accelerometer Z (g)

  Further columns, as of a magnetometer, are ignored. Each further line is one sample: a number
  for each column, with a later time than the line before. A recording has SI units.
  """

  defmodule Error do
    @moduledoc """
    An error in a recording.

    `BB.Bus.Sim.Recording.load/1` returns it, and `load!/1` raises it. `reason` is one of

    - a file error of `File.read/1`, such as `:enoent`;
    - `:wrong_header`, `:wrong_column_count`, `:not_a_number` or `:time_not_increasing`: an error
      in `line` of the file;
    - `:no_sample`: a header without samples.

    `line` counts from 1. It is `nil` for an error that belongs to no line.
    """
    @moduledoc no_example: "BB.Bus.Sim.Recording has one"

    defexception [:path, :line, :reason, :message]

    @typedoc "An error."
    @type t :: %__MODULE__{
            path: Path.t(),
            line: pos_integer() | nil,
            reason: atom(),
            message: String.t()
          }
  end

  alias BB.Bus.Sim.Motion

  @enforce_keys [:path, :times, :samples, :duration]
  defstruct [:path, :times, :samples, :duration]

  @typedoc """
  A recording.

  `times` (in s, from 0) and `samples` are tuples of the same size. `duration` (in s) is the
  length of one round when the recording repeats.
  """
  @type t :: %__MODULE__{path: Path.t(), times: tuple(), samples: tuple(), duration: float()}

  @columns [
    "Time (s)",
    "Gyroscope X (deg/s)",
    "Gyroscope Y (deg/s)",
    "Gyroscope Z (deg/s)",
    "Accelerometer X (g)",
    "Accelerometer Y (g)",
    "Accelerometer Z (g)"
  ]

  @temperature 25.0
  @radian_per_degree :math.pi() / 180

  @doc "Reads a recording from a file."
  @spec load(Path.t()) :: {:ok, t()} | {:error, Error.t()}
  def load(path) do
    with {:ok, text} <- read(path), do: parse(text, path)
  end

  @doc "Reads a recording as `load/1` does, and raises an error."
  @spec load!(Path.t()) :: t()
  def load!(path) do
    case load(path) do
      {:ok, recording} -> recording
      {:error, error} -> raise error
    end
  end

  @doc """
  Parses the text of a recording. `path` appears in errors.

      iex> header =
      ...>   "Time (s),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s)," <>
      ...>     "Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g)\\n"
      iex> text = header <> "0.00,0,0,0,0,0,1\\n0.01,0,0,0,0,0,1\\n"
      iex> {:ok, recording} = BB.Bus.Sim.Recording.parse(text)
      iex> BB.Bus.Sim.Recording.size(recording)
      2
      iex> {:error, error} = BB.Bus.Sim.Recording.parse(text <> "0.02,0,oops,0,0,0,1", "walk.csv")
      iex> Exception.message(error)
      ~s(walk.csv:4: expected a number, got: "oops")
  """
  @spec parse(String.t(), Path.t()) :: {:ok, t()} | {:error, Error.t()}
  def parse(text, path \\ "(text)") do
    [header | lines] = text |> String.trim_trailing() |> String.split(["\r\n", "\n"])

    with {:ok, count} <- columns(header), {:ok, rows} <- rows(lines, count) do
      {:ok, build(rows, path)}
    else
      {:error, {reason, line, found}} -> {:error, error(path, line, reason, found)}
    end
  end

  @doc "Returns the number of samples."
  @spec size(t()) :: pos_integer()
  def size(%__MODULE__{samples: samples}), do: tuple_size(samples)

  @doc "Returns all samples in order."
  @spec samples(t()) :: [Motion.sample()]
  def samples(%__MODULE__{samples: samples}), do: Tuple.to_list(samples)

  @doc """
  Returns the latest sample at or before `seconds` after the recording's start.

  Before the start it is the first sample. Past the end the recording repeats (`:loop`) or stays
  at its last sample (`:hold`).
  """
  @spec at(t(), number(), :loop | :hold) :: Motion.sample()
  def at(%__MODULE__{} = recording, seconds, at_end) do
    seconds = if at_end == :loop, do: wrap(seconds, recording.duration), else: seconds
    elem(recording.samples, latest(recording.times, seconds, 0, tuple_size(recording.times)))
  end

  defp wrap(seconds, duration), do: seconds - duration * Float.floor(seconds / duration)

  # Finds the greatest index in low..(high - 1) whose time is not after `seconds`.
  defp latest(_times, _seconds, low, high) when high - low <= 1, do: low

  defp latest(times, seconds, low, high) do
    middle = div(low + high, 2)

    if elem(times, middle) <= seconds,
      do: latest(times, seconds, middle, high),
      else: latest(times, seconds, low, middle)
  end

  defp read(path) do
    with {:error, reason} <- File.read(path), do: {:error, error(path, nil, reason, nil)}
  end

  defp columns(header) do
    names = split(header)

    if Enum.take(names, length(@columns)) == @columns,
      do: {:ok, length(names)},
      else: {:error, {:wrong_header, 1, header}}
  end

  defp rows([], _count), do: {:error, {:no_sample, nil, nil}}
  defp rows(lines, count), do: rows(lines, count, 2, nil, [])

  defp rows([], _count, _line, _time, rows), do: {:ok, Enum.reverse(rows)}

  defp rows([text | lines], count, line, last_time, rows) do
    with {:ok, [time | _] = row} <- row(split(text), count),
         :ok <- later(time, last_time) do
      rows(lines, count, line + 1, time, [row | rows])
    else
      {:error, {reason, found}} -> {:error, {reason, line, found}}
    end
  end

  defp row(fields, count) when length(fields) != count,
    do: {:error, {:wrong_column_count, {length(fields), count}}}

  defp row(fields, _count), do: numbers(fields, [])

  defp numbers([], numbers), do: {:ok, Enum.reverse(numbers)}

  defp numbers([field | fields], numbers) do
    case Float.parse(field) do
      {number, ""} -> numbers(fields, [number | numbers])
      _ -> {:error, {:not_a_number, field}}
    end
  end

  defp later(_time, nil), do: :ok
  defp later(time, last_time) when time > last_time, do: :ok
  defp later(time, last_time), do: {:error, {:time_not_increasing, {time, last_time}}}

  defp split(line), do: line |> String.split(",") |> Enum.map(&String.trim/1)

  defp build([[start | _] | _] = rows, path) do
    times = Enum.map(rows, fn [time | _] -> time - start end)
    samples = Enum.map(rows, &sample/1)
    last = List.last(times)

    %__MODULE__{
      path: path,
      times: List.to_tuple(times),
      samples: List.to_tuple(samples),
      duration: last + period(last, length(times))
    }
  end

  defp period(_last, 1), do: 1.0
  defp period(last, count), do: last / (count - 1)

  defp sample([_time, gx, gy, gz, ax, ay, az | _rest]) do
    %{
      acceleration: scale(ax, ay, az, Motion.standard_gravity()),
      angular_velocity: scale(gx, gy, gz, @radian_per_degree),
      temperature: @temperature
    }
  end

  defp scale(x, y, z, factor), do: {x * factor, y * factor, z * factor}

  defp error(path, line, reason, found) do
    place = if line, do: "#{path}:#{line}", else: path

    %Error{
      path: path,
      line: line,
      reason: reason,
      message: "#{place}: #{explain(reason, found)}"
    }
  end

  defp explain(:wrong_header, found),
    do:
      "expected a header that begins with #{inspect(Enum.join(@columns, ","))}, " <>
        "got: #{quote_start(found)}"

  defp explain(:wrong_column_count, {found, expected}),
    do: "expected #{expected} columns, got: #{found}"

  defp explain(:not_a_number, found), do: "expected a number, got: #{quote_start(found)}"

  defp explain(:time_not_increasing, {time, last_time}),
    do: "expected a time later than #{last_time}, got: #{time}"

  defp explain(:no_sample, _found), do: "expected samples, got only a header"
  defp explain(reason, _found), do: "#{:file.format_error(reason)}"

  defp quote_start(text), do: text |> String.slice(0, 80) |> inspect()
end
