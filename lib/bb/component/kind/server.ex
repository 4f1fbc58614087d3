defmodule BB.Component.Kind.Server do
  @moduledoc """
  Makes a module the server of a kind of component, such as `BB.Sensor.Server`.

      defmodule BB.Sensor.Server do
        use BB.Component.Kind.Server, kind: BB.Sensor
      end

  The module gets `start_link/1,2` and `child_spec/1`, for tests of drivers.
  """

  @doc false
  defmacro __using__(kind: kind) do
    quote do
      @doc """
      Starts the process.

      `args` are `:__callback_module__`, `:bb` (`%{robot: robot_module, path: path}`) and the
      module's own options. `genserver_opts` are those of `GenServer.start_link/3`; without a
      `:name` among them the process has the component's name while its robot runs.

      It returns what `GenServer.start_link/3` returns, or
      `{:error, %BB.Options.ValidationError{}}` for options that the module's schema refuses.
      """
      @spec start_link(keyword(), GenServer.options()) :: GenServer.on_start()
      def start_link(args, genserver_opts \\ []),
        do: BB.Component.Server.start_link([{:__kind__, unquote(kind)} | args], genserver_opts)

      @doc "Returns a child specification whose id contains the component's path."
      @spec child_spec(keyword()) :: Supervisor.child_spec()
      def child_spec(args),
        do: %{id: {__MODULE__, args[:bb].path}, start: {__MODULE__, :start_link, [args]}}
    end
  end
end
