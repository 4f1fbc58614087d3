defmodule Ganglion.New.Name do
  @moduledoc """
  Checks the names of a new project: the name of its application and of its robot's module.

  `Ganglion.New.Options` uses it. The application has the name of the project's folder. Neither
  name may belong to another application or module: the BEAM would load only one of the two.

      iex> Ganglion.New.Name.app("../rover")
      {:ok, "rover"}
      iex> Ganglion.New.Name.module("Rover")
      {:ok, "Rover"}
  """

  # Packages that such a project may depend on. Those of Elixir and OTP are looked up.
  @reserved_apps ~w(bb ganglion nerves nerves_runtime nerves_pack nerves_ssh nerves_motd) ++
                   ~w(nerves_time nerves_uevent nerves_bootstrap shoehorn ring_logger) ++
                   ~w(toolshed rustler muontrap vintage_net vintage_net_wifi) ++
                   ~w(vintage_net_direct vintage_net_ethernet circuits_i2c circuits_gpio) ++
                   ~w(circuits_spi circuits_uart mdns_lite ssh_subsystem_fwup) ++
                   ~w(uboot_env one_dns elixir_make)

  # The first part of module names that belong to other packages.
  @reserved_roots ~w(Elixir BB Ganglion Mix ExUnit IEx EEx Logger Hex Nerves NervesSSH) ++
                    ~w(NervesMOTD NervesPack NervesTime Shoehorn RingLogger Toolshed) ++
                    ~w(Rustler VintageNet VintageNetWiFi Circuits MdnsLite)

  @doc "Returns the name of the application for the project in the folder `path`."
  @spec app(Path.t()) :: {:ok, String.t()} | {:error, String.t()}
  def app(path) do
    name = Path.basename(path)

    cond do
      not (name =~ ~r/\A[a-z][a-z0-9_]*\z/) ->
        {:error,
         "expected a folder's name of a-z, 0-9 and _ that begins with a letter, because the " <>
           "application gets it, got: #{inspect(name)}; choose another PATH"}

      name in @reserved_apps or application?(name) ->
        {:error, "an application called #{name} exists already; choose another PATH"}

      true ->
        {:ok, name}
    end
  end

  @doc "Returns the name of the robot's module, if no module has it."
  @spec module(String.t()) :: {:ok, String.t()} | {:error, String.t()}
  def module(name) do
    cond do
      not (name =~ ~r/\A[A-Z][A-Za-z0-9_]*(\.[A-Z][A-Za-z0-9_]*)*\z/) or byte_size(name) > 200 ->
        {:error, "--module: expected a module's name such as Rover, got: #{inspect(name)}"}

      taken?(name) ->
        {:error,
         "--module: expected an unused module name, got: #{name}, which is taken; " <>
           "choose another, such as --module My#{name |> String.split(".") |> hd()}"}

      true ->
        {:ok, name}
    end
  end

  defp taken?(name) do
    hd(String.split(name, ".")) in @reserved_roots or Code.ensure_loaded?(Module.concat([name]))
  end

  # Applications of Elixir and OTP. Looking for files makes no atom of the name.
  defp application?(name) do
    Enum.any?(:code.get_path(), fn ebin -> File.exists?(Path.join(ebin, name <> ".app")) end) or
      Path.wildcard(Path.join(:code.root_dir(), "lib/#{name}-*")) != []
  end
end
