defmodule BB.Component.Kind do
  @moduledoc """
  Makes a module a kind of component. `BB.Sensor`, `BB.Actuator` and `BB.Controller` use it.

      defmodule BB.Sensor do
        use BB.Component.Kind, word: :sensor
      end

  The module gets the callbacks that all kinds have, which `BB.Component.Server` calls, and a
  `__using__` macro for callback modules (`BB.Component.Callbacks`), which it may override. The
  kind itself defines `c:BB.Component.component_options/2`. `disarm: :required` makes the callback
  `disarm/1` a required one.
  """

  @optional [disarm: 1, explain: 1, inhibition: 0, max_silence: 1, rate: 1, topics: 1]

  @doc false
  defmacro __using__(opts) do
    word = Keyword.fetch!(opts, :word)
    optional = if opts[:disarm] == :required, do: @optional -- [disarm: 1], else: @optional

    quote do
      @behaviour BB.Component

      unquote(types())
      unquote(start_callbacks())
      unquote(server_callbacks())

      @optional_callbacks unquote(optional)

      @doc false
      defmacro __using__(opts), do: BB.Component.Callbacks.code(__MODULE__, opts)
      defoverridable __using__: 1

      @doc false
      @impl BB.Component
      def component_kind, do: unquote(word)
    end
  end

  defp types do
    quote do
      @type bb :: %{robot: module(), path: [atom(), ...]}
      @type next :: timeout() | :hibernate | {:continue, term()}

      @type noreply ::
              {:noreply, new_state :: term()}
              | {:noreply, new_state :: term(), next()}
              | {:stop, reason :: term(), new_state :: term()}
    end
  end

  defp start_callbacks do
    quote do
      @doc "Returns the schema of the module's options."
      @callback options_schema() :: BB.Options.schema() | BB.Options.t()

      @doc """
      Opens the device.

      `{:stop, reason}` reports that the device is absent; `init/1` is called again after a delay.
      `:ignore` turns the component off until the robot is started again.
      """
      @callback init(opts :: keyword()) ::
                  {:ok, state :: term()}
                  | {:ok, state :: term(), next()}
                  | {:stop, reason :: term()}
                  | :ignore

      @doc """
      Makes the hardware safe.

      It is called with the options of `init/1`, and must work without the component's process,
      which may have exited.
      """
      @callback disarm(opts :: keyword()) :: :ok | {:error, term()}

      @doc """
      Returns the reason for which the robot cannot be armed before this component allows it, by
      `BB.Safety.vouch/2` or `BB.Safety.allow/2`.

      For components that watch over the robot, such as an emergency stop. The inhibition is in
      force before any process of the robot runs.
      """
      @callback inhibition() :: reason :: term()

      @doc """
      Applies new options after a parameter to which they refer has changed.

      They are checked like the options of `init/1`. By default the state does not change.
      """
      @callback handle_options(new_opts :: keyword(), state :: term()) ::
                  {:ok, state :: term()} | {:stop, reason :: term()}

      @doc """
      Formats a reason of this module as a sentence that says what to do:
      "no answer at 0x68 on i2c-1: check wiring and power".

      A reason without a clause is shown as a term.
      """
      @callback explain(reason :: term()) :: String.t()

      @doc """
      Returns how many messages a second the component publishes on its path while it works, for
      the options of `init/1`.

      `nil` declares no rate. Health shows the declared rate beside the measured one.
      """
      @callback rate(opts :: keyword()) :: number() | nil

      @doc """
      Returns whether `max_silence` can be measured with these options as declared: `:ok`, or why
      not and what to change.

      It is called while a robot that declares a `max_silence` compiles. The default is `:ok`.
      """
      @callback max_silence(opts :: keyword()) :: :ok | {:error, String.t()}

      @doc """
      Returns the ring topics that these options as declared name (`t:BB.Topic.name/0`).

      Each name is checked against the robot's topic prefix while the robot compiles, and when it
      starts.
      """
      @callback topics(opts :: keyword()) :: [BB.Topic.name()]
    end
  end

  defp server_callbacks do
    quote do
      @doc """
      Handles a call, as in `GenServer`. By default it replies `{:error, :not_implemented}`.
      """
      @callback handle_call(request :: term(), GenServer.from(), state :: term()) ::
                  {:reply, reply :: term(), new_state :: term()}
                  | {:reply, reply :: term(), new_state :: term(), next()}
                  | {:noreply, new_state :: term()}
                  | {:noreply, new_state :: term(), next()}
                  | {:stop, reason :: term(), reply :: term(), new_state :: term()}
                  | {:stop, reason :: term(), new_state :: term()}

      @doc "Handles a cast, as in `GenServer`. By default it ignores the request."
      @callback handle_cast(request :: term(), state :: term()) :: noreply()

      @doc "Handles a message, as in `GenServer`. By default it ignores the message."
      @callback handle_info(message :: term(), state :: term()) :: noreply()

      @doc "Continues after another callback, as in `GenServer`. By default it does nothing."
      @callback handle_continue(argument :: term(), state :: term()) :: noreply()

      @doc "Cleans up, as in `GenServer`. It also runs when the robot is stopped."
      @callback terminate(reason :: term(), state :: term()) :: term()
    end
  end
end
