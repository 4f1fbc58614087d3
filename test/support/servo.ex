defmodule BB.Test.Servo do
  @moduledoc """
  An actuator that sends each of its callbacks with its arguments to the observer of its robot, as
  `{:servo, name, callback, argument}`.

      BB.Test.Servo.observe(robot)
      assert_receive {:servo, :servo, :handle_command, %BB.Message{}}

  The observer may answer for a callback (`script/3`). Without a script `handle_command/2` returns
  `{:noreply, state}`.
  """

  use BB.Actuator,
    options_schema: [
      payloads: [type: {:or, [{:list, :atom}, nil]}, default: nil],
      gain: [type: :float, default: 1.0]
    ]

  @table __MODULE__

  @doc "Makes the table of scripts and observers, once, in a process that outlives all tests."
  def setup, do: :ets.new(@table, [:named_table, :public, read_concurrency: true])

  @doc "Makes the calling process the observer of a robot's servos."
  def observe(robot), do: :ets.insert(@table, {robot, self()})

  @doc "Sets the function of the state that a callback of a servo calls for its result."
  def script(robot, name, callbacks) do
    for {callback, fun} <- callbacks, do: :ets.insert(@table, {{robot, name, callback}, fun})
    :ok
  end

  @impl BB.Actuator
  def init(opts) do
    state = %{bb: opts[:bb], name: List.last(opts[:bb].path), profile: opts[:motor_profile]}
    run(state, :init, opts, &{:ok, &1})
  end

  @impl BB.Actuator
  def disarm(_opts), do: :ok

  @impl BB.Actuator
  def command_payloads(opts) do
    state = %{bb: opts[:bb], name: List.last(opts[:bb].path)}
    run(state, :command_payloads, opts, fn _ -> opts[:payloads] || super(opts) end)
  end

  @impl BB.Actuator
  def handle_command(message, state),
    do: run(state, :handle_command, message, &{:noreply, &1})

  @impl BB.Actuator
  def handle_options(opts, state),
    do: run(state, :handle_options, opts, &{:ok, %{&1 | profile: opts[:motor_profile]}})

  @impl BB.Actuator
  def handle_call(request, _from, state),
    do: run(state, :handle_call, request, &{:reply, :own_call, &1})

  @impl BB.Actuator
  def handle_cast(request, state), do: run(state, :handle_cast, request, &{:noreply, &1})

  @impl BB.Actuator
  def handle_info(message, state), do: run(state, :handle_info, message, &{:noreply, &1})

  defp run(%{bb: %{robot: robot}, name: name} = state, callback, argument, default) do
    for {_, observer} <- :ets.lookup(@table, robot),
        do: send(observer, {:servo, name, callback, argument})

    case :ets.lookup(@table, {robot, name, callback}) do
      [{_, fun}] -> fun.(state)
      [] -> default.(state)
    end
  end
end
