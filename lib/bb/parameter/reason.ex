defmodule BB.Parameter.Reason do
  @moduledoc "Why parameters could not be kept, in words. Pure."

  @doc """
  A sentence's part about what went wrong.

      iex> BB.Parameter.Reason.words(:enospc)
      "no space left on device (enospc)"
      iex> BB.Parameter.Reason.words({:bad_return_value, 17})
      "expected what BB.Parameter.Store asks for, got: 17"
  """
  @spec words(term()) :: String.t()
  def words({:timeout, timeout_ms}), do: "no answer within #{timeout_ms} ms"

  def words({:bad_return_value, value}),
    do: "expected what BB.Parameter.Store asks for, got: #{inspect(value)}"

  def words({:version, version}),
    do: "the file was written by a later release (format #{version}); update, or move it away"

  def words({:thrown, value}), do: "it threw #{inspect(value)}"
  def words({:exit, reason}), do: "it exited: #{Exception.format_exit(reason)}"
  def words(error) when is_exception(error), do: Exception.message(error)
  def words(reason) when is_atom(reason), do: posix(reason, to_string(:file.format_error(reason)))
  def words(reason), do: inspect(reason)

  defp posix(reason, "unknown POSIX error" <> _), do: inspect(reason)
  defp posix(reason, words), do: "#{words} (#{reason})"
end
