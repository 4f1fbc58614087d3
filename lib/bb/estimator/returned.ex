defmodule BB.Estimator.Returned do
  @moduledoc """
  Takes the outputs out of what a callback of an estimator returns. Pure. The rest is what a
  `GenServer` returns.

      iex> {:ok, message} = BB.Message.Sensor.Contact.new(:bumper, pressed: true)
      iex> returned = {:reply, [out: message], 1}
      iex> {outputs, rest} = BB.Estimator.Returned.split(:handle_input, returned)
      iex> {Keyword.keys(outputs), rest}
      {[:out], {:noreply, 1}}
      iex> BB.Estimator.Returned.split(:handle_call, {:reply, :pong, 1})
      {[], {:reply, :pong, 1}}
  """

  alias BB.Message

  @doc "Returns the outputs, and what the callback has returned without them."
  @spec split(atom(), term()) :: {[{atom(), Message.t()}], term()}
  def split(:handle_call, {:reply, reply, outputs, state, next}),
    do: {outputs, {:reply, reply, state, next}}

  def split(:handle_call, {:reply, reply, outputs, state}) when is_list(outputs) do
    if Enum.all?(outputs, &output?/1) and not (outputs == [] and next?(state)),
      do: {outputs, {:reply, reply, state}},
      else: {[], {:reply, reply, outputs, state}}
  end

  def split(callback, {:reply, outputs, state})
      when callback != :handle_call and is_list(outputs),
      do: {outputs, {:noreply, state}}

  def split(callback, {:reply, outputs, state, next})
      when callback != :handle_call and is_list(outputs),
      do: {outputs, {:noreply, state, next}}

  def split(_callback, returned), do: {[], returned}

  defp output?(output), do: match?({name, %Message{}} when is_atom(name), output)

  # An empty list is a state before one of these, and no outputs before a state.
  defp next?(next), do: is_integer(next) or next in [:infinity, :hibernate] or continue?(next)
  defp continue?(next), do: match?({:continue, _argument}, next)
end
