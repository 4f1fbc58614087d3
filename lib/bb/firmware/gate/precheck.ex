defmodule BB.Firmware.Gate.Precheck do
  @moduledoc """
  Decides whether an update may be written, with a reason for the uploader. Pure.
  `BB.Firmware.Gate` collects the facts.

      iex> BB.Firmware.Gate.Precheck.decide(%{lock: {:error, :updating}})
      {:error, "another update is being written"}
  """

  alias BB.Firmware.Board

  @typedoc """
  The facts: the reply of the `lock`, and if it is held the `safety` state of the robots, those
  that are `armed`, the `validation` of the running firmware, the file of the public `key`, and
  whether the `gate` runs.
  """
  @type facts ::
          %{lock: {:error, :updating | :written | :unknown}}
          | %{
              required(:lock) => :ok,
              required(:safety) => BB.Safety.state(),
              required(:validation) => Board.status() | {:error, term()},
              required(:key) => {:ok, Path.t()} | {:error, term()},
              optional(:armed) => [module()],
              optional(:gate) => :running | :not_running
            }

  @doc """
  Returns `:ok`, or `{:error, reason}`. Refuses an update when a fact is unknown, except the
  validation of a board without validation.

      iex> facts = %{lock: :ok, key: {:ok, "/etc/ganglion/firmware.pub"}}
      iex> facts = Map.merge(facts, %{safety: :disarmed, validation: :validated})
      iex> BB.Firmware.Gate.Precheck.decide(facts)
      :ok
      iex> facts = Map.merge(facts, %{safety: :armed, armed: [MyRobot]})
      iex> BB.Firmware.Gate.Precheck.decide(facts)
      {:error, "robot MyRobot is armed; disarm it with BB.Safety.disarm(MyRobot)"}
  """
  @spec decide(facts()) :: :ok | {:error, String.t()}
  def decide(facts) do
    with :ok <- lock(facts.lock),
         :ok <- key(facts.key),
         :ok <- validation(facts.validation, Map.get(facts, :gate, :running)),
         do: safety(facts.safety, Map.get(facts, :armed, []))
  end

  defp lock(:ok), do: :ok
  defp lock({:error, :updating}), do: {:error, "another update is being written"}

  defp lock({:error, :unknown}),
    do: {:error, "the state of another update is unknown; try again"}

  defp lock({:error, :written}),
    do: {:error, "an update was written, and the board is about to restart"}

  defp key({:ok, _file}), do: :ok

  defp key({:error, {file, why}}),
    do: {:error, "signatures cannot be checked: the public key #{file} #{why}"}

  defp validation(status, _gate) when status in [:validated, :unknown], do: :ok

  defp validation(:unvalidated, :running),
    do: {:error, "the running firmware is not validated yet; wait for its guard"}

  # The update would overwrite the only firmware that works. The board reverts to it soon, and
  # accepts updates then.
  defp validation(:unvalidated, :not_running) do
    {:error,
     "the running firmware is on trial, and its application does not run: " <>
       "the board reverts to the previous firmware"}
  end

  # The update repairs a board that does not answer. fwup checks the state itself, if the board
  # has one.
  defp validation({:error, _reason}, :not_running), do: :ok

  defp validation({:error, reason}, :running),
    do: {:error, "the validation of the running firmware is unknown: #{inspect(reason)}"}

  # In :error software cannot make the robot safer, and an update may be the remedy.
  defp safety(state, _armed) when state in [:disarmed, :error], do: :ok
  defp safety(:disarming, _armed), do: {:error, "the robot is being disarmed; try again"}

  defp safety(:armed, [robot | _]) do
    robot = inspect(robot)
    {:error, "robot #{robot} is armed; disarm it with BB.Safety.disarm(#{robot})"}
  end

  # It was disarmed after its state was read.
  defp safety(:armed, []), do: {:error, "the robot was armed a moment ago; try again"}
end
