defmodule Ganglion.Demo.Options do
  @moduledoc """
  Parses the command line of `bin/demo`.

  `Ganglion.Demo` uses it. It reads nothing but whether files and modules exist.

      iex> {:ok, options} = Ganglion.Demo.Options.parse(["--seconds", "5", "--json"], "/")
      iex> {options.seconds, options.json, options.robot}
      {5, true, Ganglion.Robot}
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
  @accepted "--seconds N, --robot NAME, --real, --bus NAME, --imu FILE, --frames DIR, --json, " <>
              "--help"

  defstruct seconds: nil,
            robot: Ganglion.Robot,
            real: false,
            bus: nil,
            imu: nil,
            frames: nil,
            json: false

  @typedoc "The options; `seconds: nil` runs until a signal."
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
  Parses `argv`. Invalid arguments return `{:error, sentence}`.

  Relative paths are relative to `from`; `robot` is the default robot.
  """
  @spec parse([String.t()], Path.t(), module()) :: {:ok, t()} | {:error, String.t()}
  def parse(argv, from, robot \\ Ganglion.Robot) do
    with {:ok, given} <- split(argv),
         {:ok, seconds} <- seconds(given[:seconds]),
         {:ok, robot} <- robot(given[:robot] || robot),
         :ok <- check_inputs(robot, given),
         :ok <- check_bus(given),
         {:ok, imu} <- existing(given[:imu], from, &File.regular?/1, "--imu: expected a file"),
         {:ok, frames} <-
           existing(given[:frames], from, &File.dir?/1, "--frames: expected a folder") do
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
      {given, [], []} ->
        {:ok, given}

      {_, [extra | _], []} ->
        {:error, "unexpected argument #{extra}; expected one of #{@accepted}"}

      {_, _, [{option, value} | _]} ->
        {:error, format_invalid(option, value)}
    end
  end

  defp format_invalid("--robot", nil),
    do: "--robot: expected ganglion, all or a robot's module, got nothing"

  defp format_invalid("--seconds", value),
    do: "--seconds: expected a whole number from 1 up, got: #{value || "nothing"}"

  defp format_invalid("--bus", nil),
    do: "--bus: expected the name of a bus such as i2c-1, got nothing"

  defp format_invalid(option, nil) when option in ["--imu", "--frames"],
    do: "#{option}: expected a path, got nothing"

  defp format_invalid(option, _value),
    do: "unknown option #{option}; expected one of #{@accepted}"

  defp seconds(nil), do: {:ok, nil}
  defp seconds(seconds) when seconds > 0, do: {:ok, seconds}
  defp seconds(seconds), do: {:error, format_invalid("--seconds", seconds)}

  defp robot(module) when is_atom(module), do: {:ok, module}

  defp robot(name) do
    with :error <- Map.fetch(@robots, name),
         :error <- robot_module(name),
         do: {:error, "--robot: expected ganglion, all or a robot's module, got: #{name}"}
  end

  defp robot_module(name) do
    module = if name =~ ~r/\A[A-Z][\w.]{0,200}\z/, do: Module.concat([name])

    if module && Code.ensure_loaded?(module) && function_exported?(module, :robot, 0),
      do: {:ok, module},
      else: :error
  end

  defp check_inputs(Ganglion.Robot, _given), do: :ok

  defp check_inputs(robot, given) do
    case Keyword.take(given, [:imu, :frames]) do
      [] ->
        :ok

      [{option, _} | _] ->
        {:error,
         "--#{option}: expected the robot ganglion, got: #{inspect(robot)}; " <>
           "add --robot ganglion, or leave --#{option} out"}
    end
  end

  defp check_bus(given) do
    cond do
      given[:bus] && !given[:real] ->
        {:error, "--bus names a bus of this machine, for --real: add --real"}

      given[:imu] && given[:real] ->
        {:error,
         "--imu feeds the simulated IMU, and --real uses a real one: leave one of them out"}

      true ->
        :ok
    end
  end

  defp existing(nil, _from, _exists?, _expected), do: {:ok, nil}

  defp existing(path, from, exists?, expected) do
    path = Path.expand(path, from)

    if exists?.(path),
      do: {:ok, path},
      else: {:error, "#{expected}, got: #{path}, which does not exist"}
  end
end
