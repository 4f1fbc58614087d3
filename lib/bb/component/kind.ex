defmodule BB.Component.Kind do
  @moduledoc """
  Makes a module a kind of components: `use BB.Component.Kind, word: :sensor`.

  It gets the callbacks that all kinds have, which `BB.Component.Server` calls, and a `use` of its own for callback modules
  (`BB.Component.Callbacks`). What is the kind's own is `c:BB.Component.component_options/2`.
  """

  @doc false
  defmacro __using__(word: word) do
    quote do
      @behaviour BB.Component

      unquote(types())
      unquote(starting())
      unquote(serving())

      @optional_callbacks disarm: 1, explain: 1, inhibition: 0, max_silence: 1, rate: 1, topics: 1

      @doc false
      defmacro __using__(opts), do: BB.Component.Callbacks.code(__MODULE__, opts)

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

  defp starting do
    quote do
      @doc "The schema of the module's options."
      @callback options_schema() :: BB.Options.schema() | BB.Options.t()

      @doc """
      Opens the device. `{:stop, reason}` says that it is absent, and is asked again; `:ignore` turns the component off
      for good.
      """
      @callback init(opts :: keyword()) ::
                  {:ok, state :: term()}
                  | {:ok, state :: term(), next()}
                  | {:stop, reason :: term()}
                  | :ignore

      @doc """
      Makes the hardware safe. Gets the options of `init/1` and must work without the process, which may be dead.
      """
      @callback disarm(opts :: keyword()) :: :ok | {:error, term()}

      @doc """
      Why the robot may not be armed before this component says that it may, by `BB.Safety.vouch/2` or `BB.Safety.allow/2`: for what
      watches over the robot. It is in force before anything of the robot runs.
      """
      @callback inhibition() :: reason :: term()

      @doc """
      Takes on new options, checked as those of `init/1`, when a parameter to which they refer has changed. By default they
      change nothing.
      """
      @callback handle_options(new_opts :: keyword(), state :: term()) ::
                  {:ok, state :: term()} | {:stop, reason :: term()}

      @doc """
      A reason of this module's in a sentence that says what to look at: "no answer at 0x68 on i2c-1: check wiring and power".
      Reasons that it has no clause for are shown as terms.
      """
      @callback explain(reason :: term()) :: String.t()

      @doc """
      How many messages a second it publishes on its path when all is well, with the options that `init/1` gets; `nil` where
      that is not to be said. Health shows it beside what is measured.
      """
      @callback rate(opts :: keyword()) :: number() | nil

      @doc """
      Whether `max_silence` can be measured with these options, as declared: `:ok`, or why not and
      what to change. Asked while a robot that declares one compiles; the default is `:ok`.
      """
      @callback max_silence(opts :: keyword()) :: :ok | {:error, String.t()}

      @doc """
      The ring topics that these options, as declared, name (`t:BB.Topic.name/0`), for one that works
      with any: whether each fits the robot's prefix is checked while the robot compiles, and when it
      starts.
      """
      @callback topics(opts :: keyword()) :: [BB.Topic.name()]
    end
  end

  defp serving do
    quote do
      @doc "As in `GenServer`. By default the reply is `{:error, :not_implemented}`."
      @callback handle_call(request :: term(), GenServer.from(), state :: term()) ::
                  {:reply, reply :: term(), new_state :: term()}
                  | {:reply, reply :: term(), new_state :: term(), next()}
                  | {:noreply, new_state :: term()}
                  | {:noreply, new_state :: term(), next()}
                  | {:stop, reason :: term(), reply :: term(), new_state :: term()}
                  | {:stop, reason :: term(), new_state :: term()}

      @doc "As in `GenServer`. By default the request is ignored."
      @callback handle_cast(request :: term(), state :: term()) :: noreply()

      @doc "As in `GenServer`. By default the message is ignored."
      @callback handle_info(message :: term(), state :: term()) :: noreply()

      @doc "As in `GenServer`. By default nothing is done."
      @callback handle_continue(argument :: term(), state :: term()) :: noreply()

      @doc "As in `GenServer`; also runs when the robot is stopped."
      @callback terminate(reason :: term(), state :: term()) :: term()
    end
  end
end
