defmodule Ganglion.Demo.Options do
  @moduledoc """
  The demonstration's command line: pure but for looking whether files exist.
  """

  @switches [
    seconds: :integer,
    robot: :string,
    real: :boolean,
    bus: :string,
    imu: :string,
    frames: :string,
    json: :boolean
  ]
  @robots %{"ganglion" => Ganglion.Robot, "all" => Ganglion.Robots.All}
  @accepted "--seconds N, --robot NAME, --real, --bus NAME, --imu FILE, --frames DIR, --json, --help"

  defstruct seconds: nil,
            robot: Ganglion.Robot,
            real: false,
            bus: nil,
            imu: nil,
            frames: nil,
            json: false

  @type t :: %__MODULE__{
          seconds: pos_integer() | nil,
          robot: module(),
          real: boolean(),
          bus: String.t() | nil,
          imu: Path.t() | nil,
          frames: Path.t() | nil,
          json: boolean()
        }

  @doc """
  The options of `argv`; relative paths count from `from`, `robot` is the one that is shown when none is named. A mistake is
  `{:error, sentence}`.
  """
  @spec parse([String.t()], Path.t(), module()) :: {:ok, t()} | {:error, String.t()}
  def parse(argv, from, robot \\ Ganglion.Robot) do
    with {:ok, given} <- split(argv),
         {:ok, seconds} <- seconds(given[:seconds]),
         {:ok, robot} <- robot(given[:robot] || robot),
         :ok <- only_with(robot, given),
         :ok <- check_bus(given),
         {:ok, imu} <- existing(given[:imu], from, &File.regular?/1, "--imu takes a file"),
         {:ok, frames} <- existing(given[:frames], from, &File.dir?/1, "--frames takes a folder") do
      {:ok,
       %__MODULE__{
         seconds: seconds,
         robot: robot,
         real: given[:real] || false,
         bus: given[:bus],
         imu: imu,
         frames: frames,
         json: given[:json] || false
       }}
    end
  end

  defp split(argv) do
    case OptionParser.parse(argv, strict: @switches) do
      {given, [], []} -> {:ok, given}
      {_, [extra | _], []} -> {:error, "unexpected argument #{extra}; accepted: #{@accepted}"}
      {_, _, [{option, value} | _]} -> {:error, refused(option, value)}
    end
  end

  defp refused("--robot", nil),
    do: "--robot takes ganglion or all, or a robot's module, got nothing"

  defp refused("--seconds", value),
    do: "--seconds takes a whole number from 1 up, got: #{value || "nothing"}"

  defp refused("--bus", nil), do: "--bus takes the name of a bus such as i2c-1, got nothing"

  defp refused(option, nil) when option in ["--imu", "--frames"],
    do: "#{option} takes a path, got nothing"

  defp refused(option, _value), do: "unknown option #{option}; accepted: #{@accepted}"

  defp seconds(nil), do: {:ok, nil}
  defp seconds(seconds) when seconds > 0, do: {:ok, seconds}
  defp seconds(seconds), do: {:error, refused("--seconds", seconds)}

  defp robot(module) when is_atom(module), do: {:ok, module}

  defp robot(name) do
    with :error <- Map.fetch(@robots, name),
         :error <- declared(name),
         do: {:error, "--robot takes ganglion or all, or a robot's module, got: #{name}"}
  end

  defp declared(name) do
    module = if name =~ ~r/\A[A-Z][\w.]{0,200}\z/, do: Module.concat([name])

    if module && Code.ensure_loaded?(module) && function_exported?(module, :robot, 0),
      do: {:ok, module},
      else: :error
  end

  defp only_with(Ganglion.Robot, _given), do: :ok

  defp only_with(_robot, given) do
    case Keyword.take(given, [:imu, :frames]) do
      [] -> :ok
      [{option, _} | _] -> {:error, "--#{option} is for the robot ganglion alone"}
    end
  end

  defp check_bus(given) do
    cond do
      given[:bus] && !given[:real] ->
        {:error, "--bus names a bus of this machine: add --real, which uses them"}

      given[:imu] && given[:real] ->
        {:error,
         "--imu feeds the simulated IMU, and --real has a real one: leave one of them out"}

      true ->
        :ok
    end
  end

  defp existing(nil, _from, _exists?, _what), do: {:ok, nil}

  defp existing(path, from, exists?, what) do
    path = Path.expand(path, from)
    if exists?.(path), do: {:ok, path}, else: {:error, "#{what}, and there is none at #{path}"}
  end
end
