defmodule BB.Firmware.HostKeys do
  @moduledoc """
  Renames damaged ssh host keys of a board. `BB.Firmware.Init` calls it before ssh starts.

      BB.Firmware.HostKeys.set_aside_damaged("/data/nerves_ssh")
      #=> ["/data/nerves_ssh/ssh_host_ed25519_key"]

  `nerves_ssh` overwrites a key that it cannot read with a new one. So that a damaged key is not
  lost silently, it is renamed to `….corrupt` and logged. The board then has a new key, and ssh
  clients warn about it, as after a card was burned.
  """

  require Logger

  # The host may have no ssh application.
  @compile {:no_warn_undefined, :ssh_file}

  # The keys that nerves_ssh writes.
  @files %{"ssh_host_ed25519_key" => :"ssh-ed25519", "ssh_host_rsa_key" => :"ssh-rsa"}

  @doc "Renames files in a folder that are no keys. Returns the renamed files. Never raises."
  @spec set_aside_damaged(Path.t()) :: [Path.t()]
  def set_aside_damaged(folder) do
    for {name, algorithm} <- @files,
        file = Path.join(folder, name),
        File.exists?(file),
        {:error, reason} <- [read(algorithm, folder)],
        set_aside(file, reason) == :ok,
        do: file
  end

  # Reads the key with the code of the ssh daemon, so that both accept the same keys.
  defp read(algorithm, folder) do
    ssh_file().host_key(algorithm, system_dir: String.to_charlist(folder))
  catch
    kind, reason -> {:error, {kind, reason}}
  end

  # A call by a variable, so that the compiler adds no dependency on the ssh application.
  defp ssh_file, do: :ssh_file

  defp set_aside(file, reason) do
    Logger.warning(
      "the host key #{file} cannot be read (#{inspect(reason)}); renamed to #{file}.corrupt, " <>
        "and this board gets a new one"
    )

    with {:error, posix} <- File.rename(file, file <> ".corrupt"),
         do: Logger.error("could not rename the host key #{file}: #{posix}")
  end
end
