defmodule BB.Bus.Linux.Rights do
  @moduledoc """
  Explains missing rights on a device file: which group has them, and how to get them.

  The sentences for `:eacces` of I2C buses and lines come from here.

      iex> BB.Bus.Linux.Rights.explain("/dev/i2c-none")
      "no file /dev/i2c-none: check its name, and that it is enabled"
  """

  import Bitwise

  @group_may 0o060
  @root 0

  @doc "Returns a sentence that names the group with rights on the file, and the remedy."
  @spec explain(Path.t()) :: String.t()
  def explain(path) do
    case File.stat(path) do
      {:ok, %{gid: gid, mode: mode}} when gid != @root and (mode &&& @group_may) == @group_may ->
        name_group(path, group(gid, groups()))

      {:ok, _stat} ->
        "no rights on #{path}, which only its owner may use: give it to a group by a udev " <>
          "rule (docs/guides/raspberry-pi-os.md has one), or start the program as root"

      {:error, _reason} ->
        "no file #{path}: check its name, and that it is enabled"
    end
  end

  @doc """
  Returns the name of a group in the text of /etc/group, or its number where it has no name.

      iex> BB.Bus.Linux.Rights.group(994, "root:x:0:\\ni2c:x:994:pi,robot\\n")
      "i2c"
      iex> BB.Bus.Linux.Rights.group(995, "i2c:x:994:\\n")
      "995"
  """
  @spec group(non_neg_integer(), String.t()) :: String.t()
  def group(gid, groups) do
    number = Integer.to_string(gid)

    groups
    |> String.split("\n")
    |> Enum.find_value(number, fn line ->
      with [name, _password, ^number | _members] <- String.split(line, ":"),
           do: name,
           else: (_ -> nil)
    end)
  end

  defp name_group(path, group) do
    "no rights on #{path}, which the group #{group} may use: run " <>
      "`sudo usermod -aG #{group} $USER`, then log in again"
  end

  defp groups do
    case File.read("/etc/group") do
      {:ok, groups} -> groups
      {:error, _reason} -> ""
    end
  end
end
