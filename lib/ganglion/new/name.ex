defmodule Ganglion.New.Name do
  @moduledoc """
  The names of a new project: that of its application, which is its folder's, and that of its robot's module.

  Neither may be one that something else has: the BEAM would load one of the two.
  """

  # Packages that a project of Ganglion's may come to, besides Elixir's and OTP's own, which are asked for.
  @reserved_apps ~w(bb ganglion nerves nerves_runtime nerves_pack nerves_ssh nerves_motd nerves_time) ++
                   ~w(nerves_uevent nerves_bootstrap shoehorn ring_logger toolshed rustler muontrap) ++
                   ~w(vintage_net vintage_net_wifi vintage_net_direct vintage_net_ethernet) ++
                   ~w(circuits_i2c circuits_gpio circuits_spi circuits_uart mdns_lite ssh_subsystem_fwup) ++
                   ~w(uboot_env one_dns elixir_make)

  # The first part of names that belong to others.
  @reserved_roots ~w(Elixir BB Ganglion Mix ExUnit IEx EEx Logger Hex Nerves NervesSSH NervesMOTD NervesPack NervesTime) ++
                    ~w(Shoehorn RingLogger Toolshed Rustler VintageNet VintageNetWiFi Circuits MdnsLite)

  @doc "The application's name, from the folder's."
  @spec app(Path.t()) :: {:ok, String.t()} | {:error, String.t()}
  def app(path) do
    name = Path.basename(path)

    cond do
      not (name =~ ~r/\A[a-z][a-z0-9_]*\z/) ->
        {:error,
         "expected a folder's name of a-z, 0-9 and _ that begins with a letter, for the " <>
           "application is called by it, got: #{inspect(name)}; choose another PATH"}

      name in @reserved_apps or application?(name) ->
        {:error, "an application called #{name} is there already; choose another PATH"}

      true ->
        {:ok, name}
    end
  end

  @doc "The module's name, which nobody has yet."
  @spec module(String.t()) :: {:ok, String.t()} | {:error, String.t()}
  def module(name) do
    cond do
      not (name =~ ~r/\A[A-Z][A-Za-z0-9_]*(\.[A-Z][A-Za-z0-9_]*)*\z/) or byte_size(name) > 200 ->
        {:error, "--module: expected a module's name such as Rover, got: #{inspect(name)}"}

      taken?(name) ->
        {:error,
         "--module: expected a name that nobody has, got: #{name}, which is taken; " <>
           "choose another, such as --module My#{name |> String.split(".") |> hd()}"}

      true ->
        {:ok, name}
    end
  end

  defp taken?(name) do
    hd(String.split(name, ".")) in @reserved_roots or Code.ensure_loaded?(Module.concat([name]))
  end

  # Of Elixir or OTP. As a path, for a name that is no atom yet.
  defp application?(name) do
    Enum.any?(:code.get_path(), fn ebin -> File.exists?(Path.join(ebin, name <> ".app")) end) or
      Path.wildcard(Path.join(:code.root_dir(), "lib/#{name}-*")) != []
  end
end
