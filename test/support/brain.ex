defmodule BB.Test.Brain do
  @moduledoc """
  A controller that answers `:options` with the options of its `init/1`, and fails on request.
  """

  use BB.Controller, options_schema: [rate: [type: :integer, default: 1]]

  @impl BB.Controller
  def init(opts), do: {:ok, opts}

  @impl BB.Controller
  def handle_options(opts, _old), do: {:ok, opts}

  @impl BB.Controller
  def handle_call(:options, _from, opts), do: {:reply, opts, opts}

  @impl BB.Controller
  def handle_cast(:stop, opts), do: {:stop, :confused, opts}
end
