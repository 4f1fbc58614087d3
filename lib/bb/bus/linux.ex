defmodule BB.Bus.Linux do
  @moduledoc """
  The I2C buses and GPIO chips of a machine that runs Linux without Nerves.

  Use it on Raspberry Pi OS, Ubuntu, Jetson Linux, or a PC with a USB adapter:

      config :ganglion, i2c: BB.Bus.Linux.I2C, gpio: BB.Bus.Linux.GPIO

  `BB.Bus.Linux.I2C` and `BB.Bus.Linux.GPIO` have the functions, results, messages and error atoms
  of Circuits, which needs Hex. Drivers and robots do not change. The guide
  docs/guides/raspberry-pi-os.md shows how to enable buses and who may use them.

  ## Configuration

      config :ganglion, BB.Bus.Linux, names: %{"i2c-1" => "i2c-7"}, folder: "/dev"

  - `names:`: the machine's names of I2C buses, by the names that the robot uses;
  - `folder:`: the folder of the device files.

  ## When not to use it

  On a board with Nerves, Circuits is the default and does the same. Tests and laptops use the
  simulation (`BB.Bus.Sim`), which needs no hardware.
  """

  alias BB.Bus.Linux.{Error, Rights}

  @enotty 25

  @doc "Returns the device file of an I2C bus or of a chip of lines."
  @spec path(String.t()) :: Path.t()
  def path(name), do: Path.join(folder(), Map.get(names(), name, name))

  @doc """
  Returns the names of the device files with a prefix, in the order of their numbers.

  Symbolic links are left out.
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

  @doc "Returns whether a name can only name a file in the folder, and no path out of it."
  @spec name?(String.t()) :: boolean()
  def name?(name) do
    String.valid?(name) and name not in ["", ".", ".."] and
      not String.contains?(name, ["/", <<0>>])
  end

  @doc "Checks that an I2C bus can be opened. The error is the sentence of `explain/2`."
  @spec check_bus(String.t()) :: :ok | {:error, String.t()}
  def check_bus(name) do
    with {:ok, bus} <- BB.Bus.Linux.I2C.open(name) do
      BB.Bus.Linux.I2C.close(bus)
    else
      {:error, error} -> {:error, explain(name, error)}
    end
  end

  @doc """
  Formats an error of `BB.Bus.Linux.I2C.open/2` as a sentence with the remedy.

      iex> BB.Bus.Linux.explain("i2c-1", :unknown)
      "could not use /dev/i2c-1: :unknown; look at the kernel's log"
  """
  @spec explain(String.t(), term()) :: String.t()
  def explain(name, :bus_not_found) do
    "no bus #{path(name)}: enable it, as docs/guides/raspberry-pi-os.md shows, or name " <>
      "another one" <> format_buses()
  end

  def explain(name, {:errno, @enotty}),
    do: "#{path(name)} is no I2C bus: name another one" <> format_buses()

  def explain(name, {:errno, errno} = error) do
    if Error.no_rights?(error),
      do: Rights.explain(path(name)),
      else:
        "could not use #{path(name)} as an I2C bus: #{BB.Errno.message(errno)}; name another one"
  end

  def explain(name, error),
    do: "could not use #{path(name)}: #{inspect(error)}; look at the kernel's log"

  defp format_buses do
    case devices("i2c-") do
      [] -> " (this machine has none)"
      names -> " (this machine has #{Enum.join(names, ", ")})"
    end
  end

  defp folder, do: Keyword.get(options(), :folder, "/dev")
  defp names, do: options() |> Keyword.get(:names, %{}) |> Map.new()
  defp options, do: Application.get_env(:ganglion, __MODULE__, [])
end
