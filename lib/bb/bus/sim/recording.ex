defmodule BB.Bus.Sim.Recording do
  @moduledoc """
  A recorded motion, from a CSV file, for simulated inertial sensors.

  The first line names the columns. The first seven must be

      Time (s), Gyroscope X (deg/s), Gyroscope Y (deg/s), Gyroscope Z (deg/s),
      Accelerometer X (g), Accelerometer Y (g), Accelerometer Z (g)

  and others may follow (a magnetometer, say), which are ignored. Every further line is one sample: as many numbers as there are
  columns, the time later than that of the line before. A recording holds SI units.

      iex> {:error, error} = BB.Bus.Sim.Recording.load("no_such_walk.csv")
      iex> Exception.message(error)
      "no_such_walk.csv: no such file or directory"
  """

  defmodule Error do
    @moduledoc """
    Why a recording could not be read. `reason` is one of

    - a file error of `File.read/1`, such as `:enoent`;
    - `:wrong_header`, `:wrong_column_count`, `:not_a_number`, `:time_not_increasing`: what `line` of the file is wrong for;
    - `:no_sample`: a header and nothing else.

    `line` counts from 1 and is `nil` where no line is to blame. The message says all of it in words.
    """
    defexception [:path, :line, :reason, :message]

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

  @typedoc "`times` (s, from 0) and `samples` are tuples of one size; `duration` (s) is that of one round when repeated."
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

  @doc "Reads a recording."
  @spec load(Path.t()) :: {:ok, t()} | {:error, Error.t()}
  def load(path) do
    with {:ok, text} <- read(path), do: parse(text, path)
  end

  @doc "As `load/1`, but raises the error."
  @spec load!(Path.t()) :: t()
  def load!(path) do
    case load(path) do
      {:ok, recording} -> recording
      {:error, error} -> raise error
    end
  end

  @doc """
  Reads a recording from the text of a file; `path` is for the errors.

      iex> text = \"""
      ...> Time (s),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g)
      ...> 0.00,0,0,0,0,0,1
      ...> 0.01,0,0,0,0,0,1
      ...> \"""
      iex> {:ok, recording} = BB.Bus.Sim.Recording.parse(text)
      iex> BB.Bus.Sim.Recording.size(recording)
      2
      iex> {:error, error} = BB.Bus.Sim.Recording.parse(text <> "0.02,0,oops,0,0,0,1", "walk.csv")
      iex> Exception.message(error)
      ~s(walk.csv:4: expected a number, found "oops")
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

  @doc "The number of samples."
  @spec size(t()) :: pos_integer()
  def size(%__MODULE__{samples: samples}), do: tuple_size(samples)

  @doc "All samples in order."
  @spec samples(t()) :: [Motion.sample()]
  def samples(%__MODULE__{samples: samples}), do: Tuple.to_list(samples)

  @doc """
  The latest sample taken at or before `seconds` after the recording's start; before the start, the first one.

  Past the end it is `:loop` (from the start again) or `:hold` (the last sample).
  """
  @spec at(t(), number(), :loop | :hold) :: Motion.sample()
  def at(%__MODULE__{} = recording, seconds, at_end) do
    seconds = if at_end == :loop, do: wrap(seconds, recording.duration), else: seconds
    elem(recording.samples, latest(recording.times, seconds, 0, tuple_size(recording.times)))
  end

  defp wrap(seconds, duration), do: seconds - duration * Float.floor(seconds / duration)

  # The greatest index whose time is not after `seconds`; it is in low..(high - 1).
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
      "expected a header that begins with #{inspect(Enum.join(@columns, ","))}, got: #{quote_start(found)}"

  defp explain(:wrong_column_count, {found, expected}),
    do: "expected #{expected} columns, found #{found}"

  defp explain(:not_a_number, found), do: "expected a number, found #{quote_start(found)}"

  defp explain(:time_not_increasing, {time, last_time}),
    do: "expected a time later than #{last_time}, found #{time}"

  defp explain(:no_sample, _found), do: "there is no sample in it, only a header"
  defp explain(reason, _found), do: "#{:file.format_error(reason)}"

  defp quote_start(text), do: text |> String.slice(0, 80) |> inspect()
end
