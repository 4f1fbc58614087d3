defmodule BB.Component.UserState do
  @moduledoc """
  Keeps the state of a callback module, and its timeout, in the state of the server that calls it.
  `BB.Component.Server` and `BB.Command.Server` use it.

  A server also gets messages of its own, which must not end a timeout that the callback module
  has returned. So the moment of the timeout is kept (`timeout_at_ms`), and continued:

      def handle_info(:mine, server), do: UserState.continue(server)
  """
  @moduledoc no_example: "internal: the servers of components and commands use it"

  @typedoc "The state of a server, with these two fields."
  @type server :: %{
          :user_state => term(),
          :timeout_at_ms => integer() | nil,
          optional(atom()) => term()
        }

  @doc """
  Returns what a server returns after a callback that replied, or did not, and goes on. Returns
  `:error` for a stop and for any other term.
  """
  @spec put_returned(server(), term()) :: tuple() | :error
  def put_returned(server, {:noreply, state}), do: {:noreply, put(server, state)}

  def put_returned(server, {:noreply, state, next}),
    do: {:noreply, put(server, state, next), next}

  def put_returned(server, {:reply, reply, state}), do: {:reply, reply, put(server, state)}

  def put_returned(server, {:reply, reply, state, next}),
    do: {:reply, reply, put(server, state, next), next}

  def put_returned(_server, _other), do: :error

  @doc "Puts a new state of the callback module, with its timeout in ms if `next` is one."
  @spec put(server(), term(), term()) :: server()
  def put(server, state, next \\ nil)

  def put(server, state, next) when is_integer(next),
    do: %{server | user_state: state, timeout_at_ms: now_ms() + next}

  def put(server, state, _next), do: %{server | user_state: state, timeout_at_ms: nil}

  @doc "Returns what a server returns after a message of its own: the timeout continues."
  @spec continue(server) :: {:noreply, server} | {:noreply, server, non_neg_integer()}
        when server: server()
  def continue(%{timeout_at_ms: nil} = server), do: {:noreply, server}
  def continue(server), do: {:noreply, server, max(server.timeout_at_ms - now_ms(), 0)}

  defp now_ms, do: System.monotonic_time(:millisecond)
end
