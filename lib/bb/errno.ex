defmodule BB.Errno do
  @moduledoc """
  Puts the numbers of Linux's system errors into words. For the sentences that a person reads:
  reasons keep the number.

      iex> BB.Errno.words(28)
      "no space left on device"
  """

  # errno-base.h and the part of errno.h that files, devices and shared memory give. The numbers are
  # those of all machines but MIPS and SPARC.
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
  An errno in words, or its number when it has none here.

      iex> BB.Errno.words(13)
      "permission denied"
      iex> BB.Errno.words(9_999)
      "errno 9999"
  """
  @spec words(integer()) :: String.t()
  def words(errno) do
    case fetch(errno) do
      {:ok, words} -> words
      :error -> "errno #{errno}"
    end
  end

  @doc """
  An errno in words, where it has some.

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
  The name of an errno as Erlang's, `:unknown` when it has none here.

      iex> BB.Errno.name(13)
      :eacces
      iex> BB.Errno.name(9_999)
      :unknown
  """
  @spec name(integer()) :: atom()
  def name(errno), do: Map.get(@names, errno, :unknown)
end
