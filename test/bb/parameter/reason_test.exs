defmodule BB.Parameter.ReasonTest do
  use ExUnit.Case, async: true

  alias BB.Parameter.Reason

  doctest Reason

  test "what the operating system says has words" do
    for {reason, words} <- [
          enospc: "no space left on device",
          erofs: "read-only file system",
          eisdir: "illegal operation on a directory",
          enoent: "no such file or directory",
          eacces: "permission denied",
          enotdir: "not a directory",
          eio: "I/O error",
          efbig: "file too large"
        ],
        do: assert(Reason.format(reason) == "#{words} (#{reason})")
  end

  test "what a store did has words" do
    for {reason, words} <- [
          {{:timeout, 5_000}, "no answer within 5000 ms"},
          {%RuntimeError{message: "broken"}, "broken"},
          {{:thrown, 1}, "the store threw 1"},
          {{:exit, :broken}, "the store exited: :broken"},
          {{:version, 7},
           "the file was written by a later release (format 7); update, or move it away"},
          {{:dets_open_failed, :eacces}, "permission denied (eacces)"},
          {{:dets_write_failed, {:odd, 1}}, "{:odd, 1}"},
          {{:missing_option, :path},
           "required :path option not found; add it to the store's options"},
          {:closed_today, ":closed_today"},
          {{:odd, 1}, "{:odd, 1}"}
        ],
        do: assert(Reason.format(reason) == words)
  end
end
