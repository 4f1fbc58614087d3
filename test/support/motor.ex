defmodule BB.Test.Motor do
  @moduledoc """
  An actuator that answers `:options` with the options of its `init/1`, and fails on request.
  """

  use BB.Actuator, options_schema: [rate: [type: :integer, default: 1]]

  @impl BB.Actuator
  def init(opts), do: {:ok, opts}

  @impl BB.Actuator
  def disarm(_opts), do: :ok

  @impl BB.Actuator
  def handle_command(_message, opts), do: {:noreply, opts}

  @impl BB.Actuator
  def handle_options(opts, _old), do: {:ok, opts}

  @impl BB.Actuator
  def handle_call(:options, _from, opts), do: {:reply, opts, opts}

  @impl BB.Actuator
  def handle_cast(:stop, opts), do: {:stop, :stalled, opts}
end
