defmodule BB.Bridge do
  @moduledoc """
  The behaviour of a bridge between the parameters of a robot and those of something else, such as
  the registers of a servo or a ground station. A bridge is a `GenServer` of the robot.

  Implement it to read and set parameters of a device by `BB.Parameter.list_remote/2`,
  `get_remote/3` and `set_remote/4`, or to tell a remote side of each change.

      defmodule MyRobot.Registers do
        use BB.Bridge, options_schema: [port: [type: :string, required: true]]

        @impl GenServer
        def init(opts) do
          {:ok, _} = BB.subscribe(opts[:bb].robot, [:param])
          {:ok, %{robot: opts[:bb].robot, device: open(opts[:port])}}
        end

        @impl GenServer
        def handle_call({:get_remote, id}, _from, state),
          do: {:reply, get_remote(id, state), state}

        @impl GenServer
        def handle_info({:bb, [:param | _], %{payload: changed}}, state) do
          {:ok, state} = handle_change(state.robot, changed, state)
          {:noreply, state}
        end

        @impl BB.Bridge
        def handle_change(_robot, changed, state) do
          write(state.device, changed.path, changed.new_value)
          {:ok, state}
        end

        @impl BB.Bridge
        def get_remote(id, state), do: read(state.device, id)
      end

  A robot declares it among its parameters:

      parameters do
        bridge :registers, {MyRobot.Registers, port: "ttyUSB0"}, simulation: :mock
      end

  The process is registered under the bridge's name. `init/1` receives the options, checked
  against the schema and with the values of parameters at the start, and `opts[:bb]`,
  `%{robot: robot_module, path: [name]}`. The bridge answers the calls of `BB.Parameter` itself,
  and subscribes to `[:param]` itself.

  A bridge that fails is started again, without limit and with growing pauses of up to a second
  (`BB.BridgeSupervisor`), and no other process of the robot restarts. In a simulated robot a
  bridge is omitted, a `BB.Sim.Bridge` (`simulation: :mock`) or itself (`simulation: :start`).
  """

  alias BB.Parameter.Changed

  @doc "Returns the schema of the module's options."
  @callback options_schema() :: BB.Options.schema() | BB.Options.t()

  @doc "Tells the remote side of a change of one of the robot's parameters."
  @callback handle_change(robot :: module(), Changed.t(), state :: term()) ::
              {:ok, new_state :: term()} | {:error, term()}

  @doc """
  Lists the remote parameters.

  Returns `{:ok, [%{id: id, value: value, type: type, doc: doc, path: path}]}`.
  """
  @callback list_remote(state :: term()) :: term()

  @doc "Returns the value of a remote parameter: `{:ok, value}` or `{:error, reason}`."
  @callback get_remote(id :: term(), state :: term()) :: term()

  @doc "Sets a remote parameter: `:ok` or `{:error, reason}`."
  @callback set_remote(id :: term(), value :: term(), state :: term()) :: term()

  @doc "Subscribes to the changes of a remote parameter: `:ok` or `{:error, reason}`."
  @callback subscribe_remote(id :: term(), state :: term()) :: term()

  @optional_callbacks list_remote: 1, get_remote: 2, set_remote: 3, subscribe_remote: 2

  @doc false
  defmacro __using__(opts) do
    quote do
      use GenServer

      @behaviour BB.Bridge
      @before_compile BB.Component.Callbacks
      @bb_options_schema BB.Component.Callbacks.declared_schema(unquote(opts))
    end
  end
end
