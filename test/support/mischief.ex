defmodule BB.Test.Mischief do
  @moduledoc """
  All failures of foreign code, and drivers that fail in one of their callbacks.

      module = Mischief.driver(:explain, :hang)
      Mischief.happened(module)

  The failures are counted outside of every process that they may end.
  """

  @table __MODULE__

  @kinds [:raise, :throw, :exit, :wrong, :hang, :kill, :mute, :huge, :linked]

  # Callbacks that run in the process of the component.
  @own [
    :init,
    :handle_continue,
    :handle_info,
    :handle_cast,
    :handle_call,
    :handle_options,
    :terminate
  ]

  @asked [:explain, :rate, :inhibition, :options_schema, :check]

  @doc "Makes the table, once, in a process that outlives all tests."
  def setup do
    :ets.new(@table, [:named_table, :public])
    :persistent_term.put({@table, :log}, :logger.get_handler_ids())
  end

  @doc """
  Tells whether the log still works: Erlang's logger removes a handler that fails.

  While ExUnit captures the log, newer releases of ExUnit replace the default handler.
  """
  def log_works? do
    handlers = :logger.get_handler_ids()
    missing = :persistent_term.get({@table, :log}) -- handlers
    missing == [] or (missing == [:default] and ExUnit.CaptureServer in handlers)
  end

  @doc "Returns the kinds of failures."
  def kinds, do: @kinds

  @doc "Returns the callbacks of drivers that `driver/2` can make."
  def callbacks, do: @asked ++ @own ++ [:disarm]

  @doc "Returns how often a module has failed."
  def happened(module), do: :ets.update_counter(@table, module, 0, {module, 0})

  @doc "Fails, for a module."
  def perform(module, kind) do
    :ets.update_counter(@table, module, 1, {module, 0})
    perform(kind)
  end

  defp perform(:raise), do: raise("mischief")
  defp perform(:throw), do: throw(:mischief)
  defp perform(:exit), do: exit(:mischief)
  defp perform(:wrong), do: {:mischief, [:wrong]}
  defp perform(:hang), do: Process.sleep(:infinity)
  defp perform(:kill), do: Process.exit(self(), :kill)
  defp perform(:mute), do: raise(__MODULE__.Mute, how: fn -> throw(:mischief) end)
  defp perform(:huge), do: :binary.copy("mischief", 2_000_000)

  defp perform(:linked) do
    spawn_link(fn -> exit(:mischief) end)
    Process.sleep(:infinity)
  end

  @doc """
  Returns a new module with one callback that fails, and all that is necessary to have it called.
  """
  def driver(callback, kind) do
    name = Module.concat(__MODULE__, "#{callback}_#{kind}_#{System.unique_integer([:positive])}")
    code = [use_sensor(callback, name), quiet(callback), mischief(callback, kind)]
    {:module, ^name, _, _} = Module.create(name, code, Macro.Env.location(__ENV__))
    name
  end

  @doc "Returns the callbacks of encodings that `encoding/2` can make."
  def encoding_callbacks, do: [:content, :payload, :encode, :decode]

  @doc "Returns a new encoding with one callback that fails; the others work."
  def encoding(callback, kind) do
    name = Module.concat(__MODULE__, "#{callback}_#{kind}_#{System.unique_integer([:positive])}")
    right = for other <- encoding_callbacks(), other != callback, do: encoding_callback(other)
    code = [quote(do: @behaviour(BB.Handoff.Encoding)), mischief(callback, kind) | right]
    {:module, ^name, _, _} = Module.create(name, code, Macro.Env.location(__ENV__))
    name
  end

  defp encoding_callback(:content), do: quote(do: def(content, do: "mischief"))
  defp encoding_callback(:payload), do: quote(do: def(payload, do: BB.Test.Counter.Count))
  defp encoding_callback(:encode), do: quote(do: def(encode(_message), do: "count"))

  defp encoding_callback(:decode),
    do: quote(do: def(decode(_bytes), do: BB.Test.Counter.Count.new(:decoded, n: 1)))

  defp use_sensor(:check, name) do
    schema = [n: [type: {:custom, name, :check, []}, default: 1]]
    quote do: use(BB.Sensor, options_schema: unquote(Macro.escape(schema)))
  end

  defp use_sensor(:handle_options, _name),
    do: quote(do: use(BB.Sensor, options_schema: [n: [type: :integer, default: 1]]))

  defp use_sensor(_callback, _name), do: quote(do: use(BB.Sensor))

  defp quiet(:init), do: nil
  defp quiet(:explain), do: quote(do: def(init(_opts), do: {:stop, {:absent, 1}}))

  defp quiet(:handle_continue),
    do: quote(do: def(init(opts), do: {:ok, opts[:bb], {:continue, :now}}))

  defp quiet(_callback), do: quote(do: def(init(opts), do: {:ok, opts[:bb]}))

  defp mischief(callback, kind) do
    arguments = Macro.generate_arguments(arity(callback), __MODULE__)

    quote do
      def unquote(callback)(unquote_splicing(arguments)) do
        _ = unquote(arguments)
        BB.Test.Mischief.perform(__MODULE__, unquote(kind))
      end
    end
  end

  defp arity(callback) when callback in [:inhibition, :options_schema, :content, :payload], do: 0

  defp arity(callback)
       when callback in [:explain, :rate, :check, :init, :disarm, :encode, :decode],
       do: 1

  defp arity(:handle_call), do: 3
  defp arity(_callback), do: 2
end

defmodule BB.Test.Mischief.Mute do
  @moduledoc "An exception whose message is the result of `how`."
  defexception [:how]

  @impl Exception
  def message(%{how: how}), do: how.()
end

defmodule BB.Test.Mischief.Shy do
  @moduledoc "A struct that `how` inspects."
  defstruct [:how]
end

defimpl Inspect, for: BB.Test.Mischief.Shy do
  def inspect(%{how: how}, _opts), do: how.()
end
