defmodule BB.Firmware.Gate.Decision do
  @moduledoc """
  Whether an update may be written, and if not, why, in words for who uploads. Pure.
  """

  alias BB.Firmware.Board

  @typedoc """
  What is so: the `safety` state of the robot, the `validation` of the running firmware, the `lock`'s answer, and the public `key`'s file.
  """
  @type facts :: %{
          safety: BB.Safety.state(),
          validation: Board.status() | {:error, term()},
          lock: :ok | {:error, :updating | :written},
          key: {:ok, Path.t()} | {:error, term()}
        }

  @doc """
  `:ok`, or the reason. Whatever is not known to be right is refused, but for a board that has no validation.

      iex> facts = %{safety: :disarmed, validation: :validated, lock: :ok, key: {:ok, "/etc/ganglion/firmware.pub"}}
      iex> BB.Firmware.Gate.Decision.decide(facts)
      :ok
      iex> BB.Firmware.Gate.Decision.decide(%{facts | safety: :armed})
      {:error, "the robot is armed: disarm it first"}
  """
  @spec decide(facts()) :: :ok | {:error, String.t()}
  def decide(facts) do
    with :ok <- lock(facts.lock),
         :ok <- key(facts.key),
         :ok <- validation(facts.validation),
         do: safety(facts.safety)
  end

  defp lock(:ok), do: :ok
  defp lock({:error, :updating}), do: {:error, "another update is being written"}

  defp lock({:error, :written}),
    do: {:error, "an update has been written, and the board is about to restart"}

  defp key({:ok, _file}), do: :ok

  defp key({:error, {file, why}}),
    do: {:error, "no signature could be checked: the public key #{file} #{why}"}

  defp validation(status) when status in [:validated, :unknown], do: :ok

  defp validation(:unvalidated),
    do: {:error, "the running firmware is not validated yet: wait for its guard to decide"}

  defp validation({:error, reason}),
    do: {:error, "whether the running firmware is validated is not known: #{inspect(reason)}"}

  # In :error nothing moves any more that software could stop, and an update may be the remedy.
  defp safety(state) when state in [:disarmed, :error], do: :ok
  defp safety(:armed), do: {:error, "the robot is armed: disarm it first"}
  defp safety(:disarming), do: {:error, "the robot is being disarmed: try again"}
end
