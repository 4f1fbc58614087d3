defmodule BB.Errno do
  @moduledoc """
  The texts and names of Linux's system errors.

  Use it for messages that a person reads. Error reasons keep the number:

      iex> BB.Errno.message(28)
      "no space left on device"
  """

  # From errno-base.h, and from errno.h the errors of files, devices and shared memory. The
  # numbers are the same on all machines except MIPS and SPARC.
  @names %{
    1 => :eperm,
    2 => :enoent,
    4 => :eintr,
    5 => :eio,
    6 => :enxio,
    9 => :ebadf,
    11 => :eagain,
    12 => :enomem,
    13 => :eacces,
    14 => :efault,
    16 => :ebusy,
    17 => :eexist,
    19 => :enodev,
    20 => :enotdir,
    21 => :eisdir,
    22 => :einval,
    23 => :enfile,
    24 => :emfile,
    25 => :enotty,
    26 => :etxtbsy,
    27 => :efbig,
    28 => :enospc,
    29 => :espipe,
    30 => :erofs,
    31 => :emlink,
    32 => :epipe,
    36 => :enametoolong,
    38 => :enosys,
    39 => :enotempty,
    40 => :eloop,
    71 => :eproto,
    75 => :eoverflow,
    95 => :eopnotsupp,
    110 => :etimedout,
    121 => :eremoteio,
    122 => :edquot
  }

  @doc """
  Returns the text of an errno, or its number if it is not a known one.

      iex> BB.Errno.message(13)
      "permission denied"
      iex> BB.Errno.message(9_999)
      "errno 9999"
  """
  @spec message(integer()) :: String.t()
  def message(errno) do
    case fetch(errno) do
      {:ok, text} -> text
      :error -> "errno #{errno}"
    end
  end

  @doc false
  @deprecated "Use BB.Errno.message/1"
  @spec words(integer()) :: String.t()
  def words(errno), do: message(errno)

  @doc """
  Returns the text of an errno as `{:ok, text}`, or `:error` if it is not a known one.

      iex> BB.Errno.fetch(13)
      {:ok, "permission denied"}
      iex> BB.Errno.fetch(9_999)
      :error
  """
  @spec fetch(integer()) :: {:ok, String.t()} | :error
  def fetch(errno) do
    with {:ok, name} <- Map.fetch(@names, errno),
         do: {:ok, name |> :file.format_error() |> to_string()}
  end

  @doc """
  Returns the name of an errno as Erlang names it, or `:unknown` if it is not a known one.

      iex> BB.Errno.name(13)
      :eacces
      iex> BB.Errno.name(9_999)
      :unknown
  """
  @spec name(integer()) :: atom()
  def name(errno), do: Map.get(@names, errno, :unknown)
end
