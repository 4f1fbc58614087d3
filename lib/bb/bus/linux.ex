defmodule BB.Bus.Linux do
  @moduledoc """
  The buses of a machine that runs Linux without Nerves: Raspberry Pi OS, Ubuntu, Jetson Linux, a PC
  with a USB adapter.

  `BB.Bus.Linux.I2C` and `BB.Bus.Linux.GPIO` have the functions, results, messages and error atoms
  of Circuits, which needs Hex. Drivers and robots are the same on either:

      config :ganglion, i2c: BB.Bus.Linux.I2C, gpio: BB.Bus.Linux.GPIO

  docs/guides/raspberry-pi-os.md shows how buses are enabled and who may use them.

  ## Configuration

      config :ganglion, BB.Bus.Linux, names: %{"i2c-1" => "i2c-7"}, folder: "/dev"

  - `names:`: what this machine calls an I2C bus that the robot knows by another name;
  - `folder:`: where the device files are.

  ## When not to use it

  On a board with Nerves, Circuits is the default and does the same. In tests and on a laptop the
  simulation (`BB.Bus.Sim`) needs no hardware.
  """

  alias BB.Bus.Linux.{Error, Rights}

  @enotty 25

  @doc "The file of an I2C bus, or of a chip of lines."
  @spec path(String.t()) :: Path.t()
  def path(name), do: Path.join(folder(), Map.get(names(), name, name))

  @doc """
  The names of the device files that begin so, in the order of their numbers. Links to others are
  left out.
  """
  @spec devices(String.t()) :: [String.t()]
  def devices(prefix) do
    for path <- Path.wildcard(Path.join(folder(), prefix <> "*")),
        match?({:ok, %{type: type}} when type != :symlink, File.lstat(path)),
        name = Path.basename(path),
        {number, ""} <- [name |> String.replace_prefix(prefix, "") |> Integer.parse()] do
      {number, name}
    end
    |> Enum.sort()
    |> Enum.map(&elem(&1, 1))
  end

  @doc "Whether a name is one of a file in the folder, and leads nowhere else."
  @spec name?(String.t()) :: boolean()
  def name?(name) do
    String.valid?(name) and name not in ["", ".", ".."] and
      not String.contains?(name, ["/", <<0>>])
  end

  @doc "Whether an I2C bus can be opened: `:ok`, or a sentence that says why not and the remedy."
  @spec check_bus(String.t()) :: :ok | {:error, String.t()}
  def check_bus(name) do
    with {:ok, bus} <- BB.Bus.Linux.I2C.open(name) do
      BB.Bus.Linux.I2C.close(bus)
    else
      {:error, error} -> {:error, explain(name, error)}
    end
  end

  @doc """
  Why an I2C bus cannot be opened, in a sentence with the remedy: the error of
  `BB.Bus.Linux.I2C.open/2` for the bus of that name.
  """
  @spec explain(String.t(), term()) :: String.t()
  def explain(name, :bus_not_found) do
    "there is no bus #{path(name)}: enable it, as docs/guides/raspberry-pi-os.md shows, or name " <>
      "another one" <> there()
  end

  def explain(name, {:errno, @enotty}),
    do: "#{path(name)} is no I2C bus: name another one" <> there()

  def explain(name, {:errno, errno} = error) do
    if Error.no_rights?(error),
      do: Rights.explain(path(name)),
      else:
        "#{path(name)} cannot be used as an I2C bus: #{BB.Errno.message(errno)}; name another one"
  end

  def explain(name, error),
    do: "#{path(name)} cannot be used: #{inspect(error)}; look at the kernel's log"

  defp there do
    case devices("i2c-") do
      [] -> " (this machine has none)"
      names -> " (this machine has #{Enum.join(names, ", ")})"
    end
  end

  defp folder, do: Keyword.get(options(), :folder, "/dev")
  defp names, do: options() |> Keyword.get(:names, %{}) |> Map.new()
  defp options, do: Application.get_env(:ganglion, __MODULE__, [])
end
