import Config

config :ganglion, target: Mix.target()

if Mix.target() == :host do
  import_config "host.exs"
else
  import_config "target.exs"
end
