defmodule BB.Ring.Loader do
  @moduledoc false
  # Rustler's loader where Rustler is a dependency (boards), the same in a few lines where it is not (the host has no Hex).
  # A macro, since both branches of an `if` in a module's body would be expanded.

  @library "conduit_ring_nif"

  defmacro __using__(_opts) do
    if Code.ensure_loaded?(Rustler), do: by_rustler(), else: by_hand()
  end

  defp by_rustler do
    quote do
      use Rustler,
        otp_app: :ganglion,
        crate: unquote(@library),
        skip_compilation?: true,
        load_from: {:ganglion, "priv/#{unquote(@library)}"}
    end
  end

  defp by_hand do
    quote do
      @on_load :load_nif

      @doc false
      def load_nif, do: :erlang.load_nif(BB.Ring.Loader.path(), 0)
    end
  end

  @doc false
  def path, do: :ganglion |> Application.app_dir(["priv", @library]) |> String.to_charlist()
end
