defmodule BB.Firmware.Gate.Precheck do
  @moduledoc """
  Whether an update may be written, and if not, why, in words for who uploads. Pure.
  """

  alias BB.Firmware.Board

  @typedoc """
  What is so: the `lock`'s answer, and with the lock the `safety` state of the robots, the
  `validation` of the running firmware, the public `key`'s file, and whether the `gate` is there.
  """
  @type facts ::
          %{lock: {:error, :updating | :written | :unknown}}
          | %{
              required(:lock) => :ok,
              required(:safety) => BB.Safety.state(),
              required(:validation) => Board.status() | {:error, term()},
              required(:key) => {:ok, Path.t()} | {:error, term()},
              optional(:gate) => :there | :gone
            }

  @doc """
  `:ok`, or the reason. Whatever is not known to be right is refused, but for a board that has no validation.

      iex> facts = %{safety: :disarmed, validation: :validated, lock: :ok, key: {:ok, "/etc/ganglion/firmware.pub"}}
      iex> BB.Firmware.Gate.Precheck.decide(facts)
      :ok
      iex> BB.Firmware.Gate.Precheck.decide(%{facts | safety: :armed})
      {:error, "the robot is armed: disarm it first"}
  """
  @spec decide(facts()) :: :ok | {:error, String.t()}
  def decide(facts) do
    with :ok <- lock(facts.lock),
         :ok <- key(facts.key),
         :ok <- validation(facts.validation, Map.get(facts, :gate, :there)),
         do: safety(facts.safety)
  end

  defp lock(:ok), do: :ok
  defp lock({:error, :updating}), do: {:error, "another update is being written"}

  defp lock({:error, :unknown}),
    do: {:error, "whether another update is being written is not known: try again"}

  defp lock({:error, :written}),
    do: {:error, "an update has been written, and the board is about to restart"}

  defp key({:ok, _file}), do: :ok

  defp key({:error, {file, why}}),
    do: {:error, "no signature could be checked: the public key #{file} #{why}"}

  defp validation(status, _gate) when status in [:validated, :unknown], do: :ok

  defp validation(:unvalidated, :there),
    do: {:error, "the running firmware is not validated yet: wait for its guard to decide"}

  # The only firmware that works would be written over. The board goes back to it soon, and takes
  # updates then.
  defp validation(:unvalidated, :gone) do
    {:error,
     "the running firmware is on trial, and its application does not run: " <>
       "the board goes back to the firmware before"}
  end

  # What does not answer there is part of what the update repairs. fwup looks at the state for
  # itself, where the board has one.
  defp validation({:error, _reason}, :gone), do: :ok

  defp validation({:error, reason}, :there),
    do: {:error, "whether the running firmware is validated is not known: #{inspect(reason)}"}

  # In :error nothing moves any more that software could stop, and an update may be the remedy.
  defp safety(state) when state in [:disarmed, :error], do: :ok
  defp safety(:armed), do: {:error, "the robot is armed: disarm it first"}
  defp safety(:disarming), do: {:error, "the robot is being disarmed: try again"}
end
