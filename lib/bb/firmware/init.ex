defmodule BB.Firmware.Init do
  @moduledoc """
  What happens to `/data` before anything there is used: Nerves mounts it, and makes a new file system where there is none that can
  be mounted; then damaged host keys are set aside (`BB.Firmware.HostKeys`).

      config :nerves_runtime, init_module: BB.Firmware.Init

  Other files of ours in `/data` are looked at by who reads them. The host keys belong to an application that starts before
  this one, and does not keep what it cannot read.
  """

  alias BB.Firmware.HostKeys
  alias Nerves.Runtime.Init

  # It is there on boards alone, and there the compiler shall check what is called.
  unless Code.ensure_loaded?(Init), do: @compile({:no_warn_undefined, Init})

  @doc false
  def child_spec(_opts),
    do: %{id: __MODULE__, start: {__MODULE__, :start_link, [[]]}, restart: :transient}

  @doc """
  Does it, and leaves no process. Options, for tests: `mount:` what is done first, a function without arguments; `keys:` the folder
  of the host keys, else that of `config :nerves_ssh, :system_dir`.
  """
  @spec start_link(keyword()) :: :ignore
  def start_link(opts \\ []) do
    _ = Keyword.get(opts, :mount, &Init.init_application_partition/0).()
    _ = HostKeys.set_aside_damaged(opts[:keys] || keys())
    :ignore
  end

  defp keys, do: Application.get_env(:nerves_ssh, :system_dir, "/data/nerves_ssh")
end
