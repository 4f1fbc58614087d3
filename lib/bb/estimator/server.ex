defmodule BB.Estimator.Server do
  @moduledoc """
  The part of an estimator's process that is common to all: inputs, outputs and health.

  The process is a `BB.Component.Server`, which calls the callbacks of the module through
  `call/3` of this one (`c:BB.Component.component_apply/3`). What is known here is kept in the
  process dictionary, so that the state of the process is that of the module.

  Each change of the health is emitted as `[:bb, :estimator, :transition]` and executes the
  command that is declared for it, in a process of its own: a command may have to wait.
  """
  @moduledoc no_example: "internal: BB.Estimator shows an estimator"

  require Logger

  alias BB.{Callback, Message, PubSub, Robot, Telemetry}
  alias BB.Estimator.{Context, Health, Inputs, Returned}

  @enforce_keys [:robot, :name, :declared, :inputs, :health]
  defstruct [:robot, :name, :declared, :inputs, :health, :timer]

  @lost {__MODULE__, :lost}
  @commands %{degraded: :on_degraded, lost: :on_lost, healthy: :on_recovered}

  @doc "Calls a callback of an estimator's module, in the process of the estimator."
  @spec call(module(), atom(), [term()]) :: term()
  def call(module, :init, [options]) do
    %{robot: robot, path: path} = options[:bb]
    {:ok, %{estimator: declared}} = Robot.fetch_component(robot.robot(), List.last(path))
    put(new(robot, List.last(path), declared))

    for %{path: topic} <- declared.inputs,
        do: {:ok, _} = PubSub.subscribe(robot, topic, exact: true)

    module.init(complete(options, robot, declared))
  end

  def call(module, :handle_options, [options, state]) do
    %{robot: robot, declared: declared} = get()
    module.handle_options(complete(options, robot, declared), state)
  end

  def call(module, :handle_info, [{:bb, path, %Message{} = message} = info, state]) do
    case Inputs.find(get().inputs, path) do
      nil -> publish(:handle_info, module.handle_info(info, state))
      input -> handle_input(module, input, message, state)
    end
  end

  def call(_module, :handle_info, [{:timeout, timer, @lost}, state]) do
    server = get()
    if server.timer == timer, do: change(server, Health.silent(server.health))
    {:noreply, state}
  end

  def call(module, callback, arguments),
    do: publish(callback, apply(module, callback, arguments))

  defp new(robot, name, declared) do
    restart_timer(%__MODULE__{
      robot: robot,
      name: name,
      declared: declared,
      inputs: Inputs.new(declared.inputs, declared.sync_tolerance_ns),
      health: Health.new(declared.recover_after)
    })
  end

  # Its path begins with the kind of what it stands in, as its topic does.
  defp complete(options, robot, declared) do
    context = %Context{
      robot: robot,
      path: declared.topic,
      target_frame: declared.target_frame
    }

    options
    |> Keyword.put(:bb, %{robot: robot, path: declared.topic})
    |> Keyword.put(:estimator_context, context)
  end

  # Inputs

  defp handle_input(module, input, message, state) do
    server = get()
    emit(server, :input, %{count: 1}, %{input: input.name})
    {taken, inputs} = Inputs.take(server.inputs, input, message)
    server = %{server | inputs: inputs}
    put(if(Inputs.trigger?(inputs, input), do: restart_timer(server), else: server))

    case taken do
      {:given, given} ->
        run(module, given, message, state)

      :stored ->
        {:noreply, state}

      :sync_miss ->
        server = get()
        emit(server, :dropped, %{count: 1}, %{reason: :sync_miss})
        change(server, Health.bad(server.health, :sync_miss))
        {:noreply, state}
    end
  end

  defp run(module, given, message, state) do
    started = now_ns()
    returned = module.handle_input(given, state)
    duration = now_ns() - started
    returned = publish(:handle_input, returned)
    server = get()
    latency = %{duration: duration, input_to_output: now_ns() - message.monotonic_time}
    emit(server, :latency, latency, %{})
    change(server, judge(server, duration))
    returned
  end

  defp judge(%{declared: %{latency_budget_ns: budget_ns}, health: health}, duration) do
    if budget_ns != nil and duration > budget_ns,
      do: Health.bad(health, :latency_overrun),
      else: Health.good(health)
  end

  # Outputs

  defp publish(callback, returned) do
    {outputs, rest} = Returned.split(callback, returned)
    Enum.each(outputs, &publish_output(get(), &1))
    rest
  end

  defp publish_output(server, {name, message}) do
    PubSub.publish(server.robot, topic!(server, name), message)
    emit(server, :output, %{count: 1}, %{output: name})
  end

  defp topic!(%{declared: %{outputs: outputs}} = server, name) do
    case outputs do
      %{^name => topic} ->
        topic

      _ ->
        raise ArgumentError,
              "unknown output #{inspect(name)} of estimator #{inspect(server.name)}, which " <>
                "has #{inspect(Map.keys(outputs))}; declare `output #{inspect(name)}`"
    end
  end

  # Health

  defp change(server, {:same, health}), do: put(%{server | health: health})

  defp change(%{health: %{state: from}} = server, {:changed, %{state: to} = health, reason}) do
    put(%{server | health: health})

    emit(server, :transition, %{count: 1}, %{
      previous_state: from,
      new_state: to,
      reason: reason
    })

    case Map.fetch!(server.declared, @commands[to]) do
      nil -> :ok
      command -> execute(server, command, goal(server, from, to, reason))
    end
  end

  defp goal(server, from, to, reason) do
    %{
      estimator: server.name,
      reason: reason,
      source_path: server.declared.topic,
      previous_state: from,
      new_state: to
    }
  end

  defp execute(%{robot: robot, name: name}, command, goal) do
    _ =
      spawn(fn ->
        with {:error, reason} <- start_command(robot, command, goal) do
          Logger.warning(
            "#{inspect(robot)}: estimator #{inspect(name)} is #{goal.new_state}, and its " <>
              "command #{inspect(command)} did not start: #{inspect(Callback.showable(reason))}"
          )
        end
      end)

    :ok
  end

  # A robot has a function for each of its commands.
  defp start_command(robot, command, goal) do
    apply(robot, command, [goal])
  rescue
    # The robot is ending.
    error in ArgumentError -> {:error, error}
  end

  defp restart_timer(%{declared: %{lost_after_ns: nil}} = server), do: server

  defp restart_timer(%{declared: %{lost_after_ns: lost_after_ns}} = server) do
    _ = if server.timer, do: :erlang.cancel_timer(server.timer)
    after_ms = div(lost_after_ns + 999_999, 1_000_000)
    %{server | timer: :erlang.start_timer(after_ms, self(), @lost)}
  end

  # Events and state

  defp emit(server, event, measurements, metadata) do
    metadata = Map.merge(metadata, %{robot: server.robot, estimator: server.name})
    Telemetry.emit([:bb, :estimator, event], measurements, metadata)
  end

  defp now_ns, do: System.monotonic_time(:nanosecond)
  defp get, do: Process.get(__MODULE__)

  defp put(server) do
    _ = Process.put(__MODULE__, server)
    :ok
  end
end
