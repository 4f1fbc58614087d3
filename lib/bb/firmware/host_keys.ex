defmodule BB.Firmware.HostKeys do
  @moduledoc """
  The keys by which people recognise a board over ssh: what becomes of those that are damaged.

  `nerves_ssh` makes a key where it finds none that it can read, and writes it over the one that was there. So that a damaged one is
  not lost without a word, it is renamed to `….corrupt` and logged, before ssh starts. The board then has a new key, and who logs
  in is warned of that, as after a card was burned.
  """

  require Logger

  # It comes with the ssh of boards. On the host there may be none.
  @compile {:no_warn_undefined, :ssh_file}

  # Those that nerves_ssh writes.
  @files %{"ssh_host_ed25519_key" => :"ssh-ed25519", "ssh_host_rsa_key" => :"ssh-rsa"}

  @doc "Sets aside what is no key in that folder. Returns the files that it renamed. Never raises."
  @spec set_aside_damaged(Path.t()) :: [Path.t()]
  def set_aside_damaged(folder) do
    for {name, algorithm} <- @files,
        file = Path.join(folder, name),
        File.exists?(file),
        {:error, reason} <- [read(algorithm, folder)],
        set_aside(file, reason) == :ok,
        do: file
  end

  # As the daemon reads it, so that both agree on what a key is.
  defp read(algorithm, folder) do
    ssh_file().host_key(algorithm, system_dir: String.to_charlist(folder))
  catch
    kind, reason -> {:error, {kind, reason}}
  end

  # Named so that nobody takes ssh for something that this application starts.
  defp ssh_file, do: :ssh_file

  defp set_aside(file, reason) do
    Logger.warning(
      "the host key #{file} cannot be read (#{inspect(reason)}); it is now #{file}.corrupt, and this board gets a new one"
    )

    with {:error, posix} <- File.rename(file, file <> ".corrupt"),
         do: Logger.error("#{file} was not renamed: #{posix}")
  end
end
