defmodule BB.Parameter.Reason do
  @moduledoc """
  Formats the reasons for which a store did not save parameters. Pure. The log lines and the
  alarms of `BB.Parameter` use it.

      iex> BB.Parameter.Reason.format(:enospc)
      "no space left on device (enospc)"
  """

  @doc """
  Formats a reason as part of a sentence.

      iex> BB.Parameter.Reason.format({:bad_return_value, 17})
      "expected a return value of BB.Parameter.Store, got: 17"
  """
  @spec format(term()) :: String.t()
  def format({:timeout, timeout_ms}), do: "no answer within #{timeout_ms} ms"

  def format({:bad_return_value, value}),
    do: "expected a return value of BB.Parameter.Store, got: #{inspect(value)}"

  def format({:version, version}),
    do: "the file was written by a later release (format #{version}); update, or move it away"

  def format({:dets_open_failed, reason}), do: format(reason)
  def format({:dets_write_failed, reason}), do: format(reason)

  def format({:missing_option, option}),
    do: "required #{inspect(option)} option not found; add it to the store's options"

  def format({:thrown, value}), do: "the store threw #{inspect(value)}"
  def format({:exit, reason}), do: "the store exited: #{Exception.format_exit(reason)}"
  def format(error) when is_exception(error), do: Exception.message(error)

  def format(reason) when is_atom(reason),
    do: posix(reason, to_string(:file.format_error(reason)))

  def format(reason), do: inspect(reason)

  defp posix(reason, "unknown POSIX error" <> _), do: inspect(reason)
  defp posix(reason, words), do: "#{words} (#{reason})"
end
