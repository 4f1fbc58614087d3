defmodule BB.Process.Tolerant do
  @moduledoc """
  Makes a GenServer survive calls, casts and messages that it does not handle.

  Use it in processes that must not end because of a tool or a mistake:

      use GenServer
      use BB.Process.Tolerant

  It adds a last clause to `handle_call/3`, which replies `{:error, :not_implemented}` as a
  component does, and to `handle_cast/2` and `handle_info/2`, which ignore the message.
  """

  # The clauses replace GenServer's defaults, which raise, and follow the module's own clauses.
  defmacro __using__(_opts) do
    quote do
      @doc false
      def handle_call(_request, _from, state), do: {:reply, {:error, :not_implemented}, state}

      @doc false
      def handle_cast(_request, state), do: {:noreply, state}

      @doc false
      def handle_info(_message, state), do: {:noreply, state}

      defoverridable handle_call: 3, handle_cast: 2, handle_info: 2

      @before_compile BB.Process.Tolerant
    end
  end

  @doc false
  defmacro __before_compile__(_env) do
    quote generated: true do
      def handle_call(_request, _from, state), do: {:reply, {:error, :not_implemented}, state}
      def handle_cast(_request, state), do: {:noreply, state}
      def handle_info(_message, state), do: {:noreply, state}
    end
  end
end
