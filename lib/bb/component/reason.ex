defmodule BB.Component.Reason do
  @moduledoc """
  Why a component is down: the reason of its exit, without what only a debugger wants, and in words.
  """

  @doc """
  The reason of an exit without its stack trace.

      iex> BB.Component.Reason.plain({:badarith, [{:erlang, :/, [1, 0], []}]})
      :badarith
      iex> BB.Component.Reason.plain({:i2c_nak, "i2c-1", 0x68})
      {:i2c_nak, "i2c-1", 104}
  """
  @spec plain(term()) :: term()
  def plain({reason, [{module, function, _, _} | _]}) when is_atom(module) and is_atom(function),
    do: reason

  def plain({:shutdown, reason}), do: plain(reason)
  def plain(reason), do: reason

  @doc """
  The reason in words: those of the component's own module (`explain/1`), where it has some for it.

      iex> BB.Component.Reason.words(%RuntimeError{message: "no answer"}, BB.Sensor.Mpu6050)
      "no answer"
      iex> BB.Component.Reason.words({:i2c_nak, "i2c-1", 0x68}, BB.Sensor.Mpu6050)
      ~s({:i2c_nak, "i2c-1", 104})
  """
  @spec words(term(), module()) :: String.t()
  def words(reason, _module) when is_exception(reason), do: Exception.message(reason)
  def words(reason, _module) when is_binary(reason), do: reason

  def words({:init_timeout, timeout_ms}, _module),
    do: "its init has not returned for #{timeout_ms} ms"

  def words({:silent, silence_ms}, _module),
    do: "it has published nothing for #{silence_ms} ms"

  def words(reason, module) do
    explains? = Code.ensure_loaded?(module) and function_exported?(module, :explain, 1)
    if explains?, do: module.explain(reason), else: inspect(reason)
  rescue
    # It has no words for it, or is wrong itself: who asks how all sensors fare must not suffer from one.
    _error -> inspect(reason)
  end
end
